"""The run-time query: all facts about a robot for other programs, as one object and as JSON.

SI units and radians, frames as in docs/conventions.md. `read_facts` reads and validates the JSON;
`RobotFacts.model_json_schema()` describes it.
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
from tci.skin.surfaces import Surface, build_surface

CONVENTIONS: tuple[Convention, ...] = ("classic", "modified")
"""Conventions of Denavit-Hartenberg tables."""


class GenericLimits(Description):
    """Limits of a generic joint: those of its servo, through the joint's transform."""

    joint: str
    """Name of the generic joint."""
    lower: float | None
    """Lower limit [rad]; None if the robot's is unknown, or the joint depends on several servos or none."""
    upper: float | None
    """Upper limit [rad]; None as for `lower`."""


class DHRow(Description):
    """One joint of a Denavit-Hartenberg table."""

    servo: int
    """Index into `RobotFacts.servos`."""
    a: float
    """Length of the common normal [m]."""
    alpha: float
    """Twist [rad]."""
    d: float
    """Offset along the joint's axis [m]."""
    theta: float
    """Angle [rad] at which the servo reads zero."""


class DHTable(Description):
    """Denavit-Hartenberg table of one chain, from the torso frame to a link."""

    part: str
    convention: Literal["classic", "modified"]
    base: Matrix
    """Pose (4, 4) of the first frame in the torso frame."""
    rows: tuple[DHRow, ...]
    tool: Matrix
    """Pose (4, 4) of the link in the last frame."""
    link: str


class Taxel(Description):
    """One taxel of a patch."""

    channel: int
    """Index into the raw frame."""
    position: Vector
    """Position [m] in the patch's link."""
    normal: Vector
    """Outward unit normal in the patch's link."""
    area: float
    """Area [m2]."""


class ConeFacts(Description):
    """The paper's truncated cone (eqs 3-4) fitted to a patch's taxels, and its radial error."""

    length: float
    """Length [m]."""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rms: float
    """Root mean square of the radial error [m]."""
    largest: float
    """Largest radial error [m]."""


class PatchFacts(Description):
    """One patch of skin."""

    name: str
    part: str
    segment: str
    link: str
    kind: str
    """Form in which its surface is described."""
    rate: float
    """Frames per second [Hz]."""
    channels: int
    """Number of values in a raw frame."""
    through_joints: bool = False
    """True if it sends no frames and touches are felt through joints; its taxels only span the surface."""
    area: float
    """Total area of its taxels [m2]."""
    cone: ConeFacts | None
    """Fitted cone; None if no cone fits: skin without a limb, or too few taxels."""
    taxels: tuple[Taxel, ...]


class RobotFacts(Description):
    """All facts of a robot that other programs may ask for."""

    format: Literal["tci.robot/1"] = "tci.robot/1"
    name: str
    title: str
    digest: str
    """SHA-256 of the description."""
    servos: tuple[Servo, ...]
    """Limits, units [rad] and modes of all servos, in the order of joint readings."""
    couplings: tuple[Coupling, ...]
    parts: tuple[GenericPart, ...]
    generic_limits: dict[str, tuple[GenericLimits, ...]]
    """Limits of the generic joints, by part."""
    links: tuple[KinematicLink, ...]
    """Frames and inertias. Empty without a kinematic model; so are the fields below that need one."""
    torso_link: str
    torso_pose: Matrix
    """Pose (4, 4) of the torso frame in that link."""
    denavit_hartenberg: tuple[DHTable, ...]
    chains: dict[str, tuple[ChainSegment, ...]]
    """Segments for OROCOS KDL, by part."""
    patches: tuple[PatchFacts, ...]
    fields: tuple[ReceptiveField, ...]
    """Receptive fields of the withdrawal reflex (assumed, see `default_fields`), on the generic limb."""


def query(robot: Robot) -> RobotFacts:
    """Returns all facts of a robot. Raises DescriptionError for a kinematic model that can't be read."""
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
    """Reads facts from their JSON; error messages name `source`.

    Raises DescriptionError with all faults at once: text that is not JSON, another format or version, a
    missing or unknown field, a value of the wrong type.
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
    """Returns the limits of a part's generic joints [rad], in order. Raises UnknownNameError."""
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
    """Returns the lowest and highest angle [rad] of a joint that several servos move; NaN without limits."""
    low = high = joint.offset
    for term in joint.terms:
        limits = robot.servos[term.servo].limits
        ends = [np.nan if end is None else term.factor * end for end in (limits.lower, limits.upper)]
        low, high = low + min(ends), high + max(ends)
    return low, high


def dh_tables(robot: Robot) -> tuple[DHTable, ...]:
    """Returns classic and modified tables of every part that the torso carries by revolute joints alone.

    Raises DescriptionError.
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
                through_joints=patch.through_joints,
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
