"""Defines the data with which a served robot answers a query: all facts about the robot, as one object and as
JSON.

Values are in SI units and radians. docs/conventions.md describes the frames. `read_facts` reads and validates
the JSON. `RobotFacts.model_json_schema()` returns the schema of the JSON.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import ValidationError

from tci.capabilities.fields import ReceptiveField, default_fields
from tci.errors import DescriptionError, Fault, TciError
from tci.exports.chain import ChainSegment, chain_to, ends_of
from tci.exports.cone import cone_of
from tci.exports.denavit_hartenberg import Convention, denavit_hartenberg
from tci.exports.tree import KinematicLink, Matrix, links_of, rows, vector
from tci.robot.description import Coupling, Description, GenericPart, GenericServo, Robot, Servo, Vector
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.like import RobotLike, as_robot
from tci.skin.surfaces import Surface, build_surface

CONVENTIONS: tuple[Convention, ...] = ("classic", "modified")
"""Conventions of the Denavit-Hartenberg tables in the facts of a robot."""


class GenericLimits(Description):
    """Limits of a generic joint, computed from the limits of the servos that move the joint."""

    joint: str
    """Name of the generic joint."""
    lower: float | None
    """Lower limit [rad], or None if a servo's limit is unknown, if no servo moves the joint, or if the limit
    depends on the angles of other joints."""
    upper: float | None
    """Upper limit [rad], or None if a servo's limit is unknown, if no servo moves the joint, or if the limit
    depends on the angles of other joints."""


class DHRow(Description):
    """One row of a Denavit-Hartenberg table, for one joint."""

    servo: int
    """Index of the joint's servo in `RobotFacts.servos`."""
    a: float
    """DH parameter a: length [m] of the common normal of two successive joint axes."""
    alpha: float
    """DH parameter alpha: angle [rad] between two successive joint axes."""
    d: float
    """DH parameter d: offset [m] along the joint's axis."""
    theta: float
    """DH parameter theta: joint angle [rad] with the servo at zero."""


class DHTable(Description):
    """Denavit-Hartenberg table of one chain, from the torso frame to a link."""

    part: str
    convention: Literal["classic", "modified"]
    base: Matrix
    """Pose (4, 4) of the table's first frame, in the torso frame."""
    rows: tuple[DHRow, ...]
    tool: Matrix
    """Pose (4, 4) of the link `link`, in the table's last frame."""
    link: str


class Taxel(Description):
    """One taxel of a patch."""

    channel: int
    """Index of the taxel's value in a raw skin frame."""
    position: Vector
    """Position [m] in the frame of the patch's link."""
    normal: Vector
    """Outward unit normal of the skin, in the frame of the patch's link."""
    area: float
    """Area [m2] of skin that belongs to the taxel."""


class ConeFacts(Description):
    """A truncated cone (eqs. 3-4 of the paper), fitted to a patch's taxels, and the radial errors of the
    fit."""

    length: float
    """Length [m]."""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rms: float
    """Root mean square [m] of the radial errors of all taxels."""
    largest: float
    """Largest absolute value [m] of the radial errors of all taxels."""


class PatchFacts(Description):
    """One patch of skin."""

    name: str
    part: str
    segment: str
    link: str
    kind: str
    """Kind of surface in the description of the patch: `truncated_cone`, `grid`, `triangular_modules` or
    `table`."""
    rate: float
    """Rate [Hz] of the patch's skin frames."""
    channels: int
    """Number of values in a raw skin frame."""
    through_joints: bool = False
    """True if the patch has no sensors and sends no frames. Touches on such a patch are detected from joint
    torques, and its taxels only describe its surface."""
    assumed: bool = False
    """True if nobody has seen this skin on the robot."""
    area: float
    """Total area [m2] of the patch's taxels."""
    cone: ConeFacts | None
    """Fitted cone, or None if no cone can be fitted, because the patch is on no limb or has too few
    taxels."""
    taxels: tuple[Taxel, ...]


class RobotFacts(Description):
    """All facts of a robot that other programs can query."""

    format: Literal["tci.robot/1"] = "tci.robot/1"
    name: str
    title: str
    digest: str
    """SHA-256 of the robot's description."""
    servos: tuple[Servo, ...]
    """All servos with their limits [rad] and control modes. Joint readings list the servos in this order."""
    couplings: tuple[Coupling, ...]
    parts: tuple[GenericPart, ...]
    generic_limits: dict[str, tuple[GenericLimits, ...]]
    """Limits of the generic joints of each part, by the part's name."""
    links: tuple[KinematicLink, ...]
    """Frames and inertias of all links. If the robot has no kinematic model, this field is empty, and so are
    all following fields that need a model."""
    torso_link: str
    torso_pose: Matrix
    """Pose (4, 4) of the torso frame, in the frame of the link `torso_link`."""
    denavit_hartenberg: tuple[DHTable, ...]
    chains: dict[str, tuple[ChainSegment, ...]]
    """Kinematic chain to the end of each part, as segments of OROCOS KDL, by the part's name. A chain begins
    at the torso or, for parts that the torso does not carry, at the root of the model.
    """
    patches: tuple[PatchFacts, ...]
    fields: tuple[ReceptiveField, ...]
    """Receptive fields of the withdrawal reflex on the generic limb. The values of these fields are assumed,
    see `default_fields`."""


def query(robot: RobotLike) -> RobotFacts:
    """Returns all facts of a robot. Raises DescriptionError if the kinematic model can't be read."""
    robot = as_robot(robot)
    model = robot.model is not None
    ends = ends_of(robot) if model else {}
    return RobotFacts(
        name=robot.name,
        title=robot.title,
        digest=robot.digest,
        servos=robot.servos,
        couplings=robot.couplings,
        parts=robot.parts,
        generic_limits={part.name: generic_limits(robot, part.name) for part in robot.parts},
        links=links_of(robot) if model else (),
        torso_link=robot.model.torso_link if robot.model else "",
        torso_pose=rows(robot.model.T_LT if robot.model else np.eye(4)),
        denavit_hartenberg=dh_tables(robot) if model else (),
        chains={part: chain_to(robot, link) for part, link in ends.items()},
        patches=_patches(robot) if model else (),
        fields=default_fields() if robot.patches else (),
    )


def read_facts(text: str | bytes, *, source: str = "facts of a robot") -> RobotFacts:
    """Returns the facts that the JSON `text` contains. Error messages name this text by `source`.

    Raises DescriptionError with all faults at once. Examples of faults: the text is not JSON, the format or
    version is not supported, a field is missing or unknown, or a value has the wrong type.
    """
    try:
        return RobotFacts.model_validate_json(text)
    except ValidationError as error:
        faults = []
        for found in error.errors(include_url=False, include_context=False):
            place = ".".join(str(step) for step in found["loc"])
            faults.append(Fault(0, f"{place}: {found['msg']}" if place else found["msg"]))
        raise DescriptionError(source, faults) from None


def generic_limits(robot: Robot, part: str) -> tuple[GenericLimits, ...]:
    """Returns the limits [rad] of a part's generic joints, in the part's order. Raises UnknownNameError for
    an unknown part."""
    joints = joint_map(robot, part)
    ends = []
    for side in ("lower", "upper"):
        limits = [getattr(servo.limits, side) for servo in robot.servos]
        ends.append(joints.to_generic(np.array([np.nan if limit is None else limit for limit in limits])))
    facts = []
    for joint, low, high in zip(robot.part(part).servos, *np.sort(ends, axis=0), strict=True):
        if joint.transform == "synergy":
            low, high = _reach(robot, joint)
        own = (
            joint.servo is not None
            and joint.transform in ("linear", "table", "synergy")
            and np.isfinite(low + high)
        )
        lower, upper = (float(low), float(high)) if own else (None, None)
        facts.append(GenericLimits(joint=joint.name, lower=lower, upper=upper))
    return tuple(facts)


def _reach(robot: Robot, joint: GenericServo) -> tuple[float, float]:
    """Returns the lowest and highest angle [rad] of a joint that several servos move together. Both are NaN
    if a limit of one of these servos is unknown."""
    low = high = joint.offset
    for term in joint.terms:
        limits = robot.servos[term.servo].limits
        ends = [np.nan if end is None else term.factor * end for end in (limits.lower, limits.upper)]
        low, high = low + float(np.min(ends)), high + float(np.max(ends))  # NaN if an end is NaN
    return low, high


def dh_tables(robot: Robot) -> tuple[DHTable, ...]:
    """Returns the DH tables of all parts, a classic and a modified table for each part. Leaves out parts with
    a prismatic joint between the torso and the last link of the part.

    Raises DescriptionError if the kinematic model can't be read.
    """
    kinematics = KinematicChain(robot)
    tables = []
    for part, link in ends_of(robot).items():
        if not kinematics.chain(link):
            continue
        if any(segment.slides for segment in chain_to(robot, link)):
            continue
        for convention in CONVENTIONS:
            dh = denavit_hartenberg(kinematics, link, convention=convention)
            numbers = zip(*(values.tolist() for values in (dh.a, dh.alpha, dh.d, dh.theta)), strict=True)
            tables.append(
                DHTable(
                    part=part,
                    convention=convention,
                    base=rows(dh.base),
                    rows=tuple(
                        DHRow(servo=servo, a=a, alpha=alpha, d=d, theta=theta)
                        for servo, (a, alpha, d, theta) in zip(dh.servos, numbers, strict=True)
                    ),
                    tool=rows(dh.tool),
                    link=link,
                )
            )
    return tuple(tables)


def _patches(robot: Robot) -> tuple[PatchFacts, ...]:
    kinematics = KinematicChain(robot)
    facts = []
    for patch in robot.patches:
        surface = build_surface(robot, patch, kinematics)
        numbers = zip(surface.channels, surface.positions, surface.normals, surface.areas, strict=True)
        taxels = tuple(
            Taxel(channel=int(channel), position=vector(p), normal=vector(n), area=float(area))
            for channel, p, n, area in numbers
        )
        facts.append(
            PatchFacts(
                name=patch.name, part=patch.part, segment=patch.segment, link=patch.link,
                kind=patch.surface.kind, rate=patch.rate, channels=patch.channels,
                through_joints=patch.through_joints, assumed=patch.assumed,
                area=float(surface.areas.sum()), cone=_cone(robot, surface, kinematics), taxels=taxels,
            )
        )  # fmt: skip
    return tuple(facts)


def _cone(robot: Robot, surface: Surface, kinematics: KinematicChain) -> ConeFacts | None:
    try:
        fit = cone_of(robot, surface, kinematics)
    except TciError:
        return None
    return ConeFacts(length=fit.length, r1=fit.r1, r2=fit.r2, rms=fit.rms, largest=fit.largest)
