"""The generic interface to one robot: geometry for perceptions, and conversion of commands (Fig. 2, L3)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.body.cartesian import Reach, cartesian_to_platform, reach_of
from tci.body.coverage import Coverage
from tci.body.gaze import Gaze, Look
from tci.body.landmarks import Landmarks
from tci.body.pace import UNBOUNDED, Pace, Paces
from tci.body.places import Place, find_place
from tci.body.posture import expected, generic_columns, home, switch, to_platform
from tci.body.retreat import Retreat
from tci.body.support import StaticStability
from tci.errors import CommandError, TciError
from tci.joint_touch.contacts import JointTouchSettings
from tci.messages import (
    CartesianCommand,
    Contact,
    ExpectContact,
    GenericCommand,
    JointReading,
    Landmark,
    LimbPlace,
    Mode,
    ModeLike,
    Order,
    Perception,
    PlatformCommand,
    PlatformOrder,
    PlatformSwitch,
    Support,
    SwitchMode,
)
from tci.messages.frames import Array, read_only
from tci.reasons import Reason
from tci.robot.blow import Struck
from tci.robot.description import Kind, Robot
from tci.robot.joint_calibration import JointCalibration
from tci.robot.joint_map import JointMap, generic_posture, joint_map
from tci.robot.like import RobotLike, as_robot
from tci.robot.skin_files.calibration import SkinCalibration
from tci.skin.conditioning import ConditioningSettings
from tci.skin.contacts import ContactSettings
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class BodySettings:
    """Settings of the perception of a robot."""

    contacts: ContactSettings = field(default_factory=ContactSettings)
    """Conditions under which active taxels form a contact."""
    conditioning: ConditioningSettings = field(default_factory=ConditioningSettings)
    """Settings of the conversion of raw frames to pressures."""
    calibration: SkinCalibration | None = None
    """Measured rest values, noise and response of the taxels. If None, the file that `tci skin calibrate`
    wrote into the folder of the description is used, if this file exists."""
    joints: JointTouchSettings = field(default_factory=JointTouchSettings)
    """Conditions under which joint torques count as a touch, for patches that have no taxels."""
    joint_calibration: JointCalibration | None = None
    """Friction of the joints, and tools in the hands. If None, the file that `tci check --hardware` wrote
    into the folder of the description is used, if this file exists."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class GenericBody:
    """The generic interface to one robot: computes geometry for perceptions, and converts generic commands to
    joint commands.

    The object is immutable, and a pickle contains only the robot and the settings. All state that changes is
    in a `Perceiver`.
    """

    robot: Robot
    settings: BodySettings
    skin: Skin
    """Skin of the robot: surfaces with the positions of the taxels."""
    layout: SkinLayout
    """Arrays with the data of all taxels. The order of the taxels is that in the arrays of a perception."""
    joint_maps: Mapping[str, JointMap]
    """Transforms between generic joints and servos, by name of the generic part."""
    _parts: Mapping[Kind, tuple[str, ...]]
    _has_joint: Mapping[str, NDArray[np.bool_]]
    _landmarks: Landmarks
    _stability: StaticStability
    _retreat: Retreat
    _paces: Paces
    _coverage: Coverage
    _gaze: Gaze

    def __init__(self, robot: RobotLike, settings: BodySettings | None = None) -> None:
        """Builds all tables that depend only on the robot.

        Raises DescriptionError for a model or a skin that can't be used, and TciError for a calibration that
        does not fit the robot.
        """
        robot, settings = as_robot(robot), settings or BodySettings()
        skin = Skin(robot)
        landmarks = Landmarks(skin)
        kinds = {one.kind: tuple(p.name for p in robot.parts if p.kind == one.kind) for one in robot.parts}
        has = {
            part.name: read_only([j.servo is not None for j in part.servos], np.bool_) for part in robot.parts
        }
        layout = SkinLayout.of_robot(robot, settings.calibration)
        self._set(
            robot=robot,
            settings=settings,
            skin=skin,
            layout=layout,
            joint_maps=MappingProxyType({part.name: joint_map(robot, part.name) for part in robot.parts}),
            _parts=kinds,
            _has_joint=has,
            _landmarks=landmarks,
            _stability=StaticStability(skin.robot),
            _retreat=(retreat := Retreat(skin, layout)),
            _paces=Paces(robot, retreat),
            _coverage=Coverage(skin, landmarks),
            _gaze=Gaze(skin, retreat),
        )

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        parts = ", ".join(self._has_joint)
        taxels = sum(len(self.skin.surfaces[patch.name].positions) for patch in self.robot.skin)
        return f"GenericBody({self.robot.name!r}: {parts}; {taxels} taxels)"

    def __reduce__(self) -> tuple[type[GenericBody], tuple[Robot, BodySettings]]:
        return type(self), (self.robot, self.settings)

    def __deepcopy__(self, memo: object) -> GenericBody:
        return self

    def parts(self, kind: Kind) -> tuple[str, ...]:
        """Returns the names of the generic parts of a kind, such as "arm" or "leg"."""
        return self._parts.get(kind, ())

    def has_joint(self, part: str) -> NDArray[np.bool_]:
        """Returns a mask (n,) of the generic joints of a part that this robot has.

        Raises UnknownNameError for an unknown part.
        """
        return self._has_joint[self.robot.part(part).name]

    def tied(self, part: str) -> tuple[tuple[int, ...], ...]:
        """Returns groups of indices of generic joints.

        The joints of a group share motors, so they can move only together. Each joint of the part that this
        robot has is in exactly one group. Raises UnknownNameError for an unknown part.
        """
        return self.joint_maps[self.robot.part(part).name].tied

    def posture(self, joints: JointReading) -> dict[str, Array]:
        """Returns the generic angles (n,) [rad] of every part, by name (eqs. 1-2).

        Raises FrameError if the numbers of joints of the reading and of the robot differ.
        """
        return generic_posture(self.robot, joints)

    def home(self, part: str) -> tuple[GenericCommand, ...]:
        """Returns the commands that set the initial stiffness and damping of a part and move the part to its
        initial posture.

        Raises UnknownNameError for an unknown part.
        """
        return home(self.robot.part(part))

    def place(self, part: str, place: LimbPlace, joints: JointReading) -> Place:
        """Returns the point of the robot's skin that corresponds to a place on the generic limb of a part.

        Raises TciError if there is no skin at this place, UnknownNameError for an unknown part or segment.
        """
        return find_place(self.skin, part, place.segment, place.u, place.theta, joints)

    def landmark(self, part: str, landmark: Landmark) -> Place:
        """Returns the point of a part's skin at a landmark.

        Raises TciError if the part has no skin at this landmark, UnknownNameError for an unknown part.
        """
        return self._landmarks.place(part, landmark)

    def prepare(self, part: str, landmarks: Iterable[Landmark]) -> None:
        """Computes the geodesic distance maps of landmarks in advance.

        Call this method before the loop starts, since one map takes longer than a period of the loop.
        """
        for landmark in landmarks:
            self._landmarks.around(part, landmark, 0.0)

    def reach(self, part: str, point: str = "hand") -> Reach:
        """Returns the kinematics of a point of a part, such as the "hand" of an arm, for Cartesian commands.

        Raises CommandError if the part has no such point, UnknownNameError for an unknown part.
        """
        return reach_of(self.robot, part, point)

    def jacobian(self, perception: Perception, contact: Contact, part: str = "") -> Array:
        """Returns the Jacobian (3, n) [m/rad] of the contact point with respect to the generic joints of the
        touched part, or of another `part` that carries it, such as the arm of a touched finger.

        The Jacobian is expressed in the torso frame, with zero columns for joints that the robot lacks. The
        transpose of the Jacobian maps a force at the contact to torques of the generic joints.
        """
        position = _joints(perception).position
        link = self.robot.patch(contact.patch).link
        moved = self.skin.kinematics.jacobian(position, link, point=contact.p_L)[:3]
        return read_only(generic_columns(self.robot, part or contact.part, moved, position))

    def retreat(
        self,
        perception: Perception,
        part: str,
        target: ArrayLike,
        mode: ModeLike = Mode.POSITION,
        *,
        driven: bool = False,
    ) -> Array:
        """Returns displacements (3, k, c) [m] for c contacts at k times while `part` moves to `target` (n,)
        [rad].

        The rows are the displacement of the contact point along the inward normal, the length of its
        displacement perpendicular to the normal, and the depth by which any skin enters the touching object;
        see `Retreat.along`. `driven` is True for a capability that commands a velocity in each period. The
        motion respects the robot's limits in `mode`.
        """
        position, goal = _joints(perception).position, np.asarray(target, np.float64)
        return self._retreat.along(position, perception.contacts, part, goal, Mode.of(mode), driven=driven)

    def retreat_at_ends(self, perception: Perception, part: str, targets: ArrayLike) -> Array:
        """Returns the normal and the tangential displacement (2, m, c) [m] of c contact points at the ends of
        m motions of `part`.

        The motions go to the rows of `targets` (m, n) [rad]. The result equals the first two rows that
        `retreat` returns for the end of a motion, but needs much less computing time.
        """
        position, goals = _joints(perception).position, np.asarray(targets, np.float64)
        return self._retreat.at_ends(position, perception.contacts, part, goals)

    def rate(self, perception: Perception, part: str) -> Array:
        """Measured speeds (n,) [rad/s] of the generic joints of a part; 0 for joints that the robot lacks,
        and where no speed is measured."""
        joints, own = _joints(perception), self.joint_maps[self.robot.part(part).name]
        rate = np.zeros(own.fixed.shape)
        rate[own.ids] = own.slope(joints.position) @ np.nan_to_num(joints.velocity[own.servos])
        return rate

    def effort(self, perception: Perception, part: str) -> Array | None:
        """Measured torques (n,) [N m] of the generic joints of a part, weights included; 0 for joints that
        the robot lacks, None where torques are not measured."""
        joints, own = _joints(perception), self.joint_maps[self.robot.part(part).name]
        if joints.torque is None or not np.isfinite(joints.torque[own.servos]).all():
            return None
        effort = np.zeros(own.fixed.shape)
        slope = own.slope(joints.position)
        effort[own.ids] = np.linalg.lstsq(slope.T, joints.torque[own.servos], rcond=None)[0]
        return read_only(effort)

    def pace(self, perception: Perception, part: str, target: ArrayLike, people: Sequence[Struck]) -> Pace:
        """How fast `part` may move to `target` (n,) [rad] so that it strikes nobody in its way harder than
        `people` say, and the force [N] that no blow exceeds then."""
        if perception.joints is None:
            return UNBOUNDED
        position, goal = perception.joints.position, np.asarray(target, np.float64)
        return self._paces.pace(position, part, perception.posture[part], goal, people)

    def yield_to(
        self, perception: Perception, contacts: Sequence[Contact], rates: ArrayLike, most: ArrayLike,
        part: str = "",
    ) -> Array:  # fmt: skip
        """The speeds (n,) [rad/s] nearest to `rates` (n,) with which no contact point of a part moves faster
        into what touches it than `most` (c,) [m/s] says; below 0 it moves away. If not all are possible, the
        largest excess is as small as 20 corrections make it.

        Args:
            perception: what is felt now.
            contacts: c contacts of one part.
            rates: wanted speeds of its generic joints.
            most: largest speed of each contact point, along the skin's outward normal.
            part: whose joints move, if it only carries the touched ones, as an arm its fingers.
        """
        into = np.array([self.jacobian(perception, one, part).T @ one.n_T for one in contacts])
        return slowed(rates, into, most)

    def look_at(self, perception: Perception, point: ArrayLike) -> Look:
        """How to look at `point` (3,) [m] in the torso frame, such as a contact's `p_T`: which part turns,
        and to which generic angles. A robot without a neck turns its waist. The point stays where it is in
        space: don't ask for one on a part that the waist carries along.

        Raises CommandError for a robot that has neither (`turns_gaze` is empty), and for another shape.
        """
        return self._gaze.look(_joints(perception).position, np.asarray(point, np.float64))

    def eyes(self, joints: JointReading) -> Array:
        """Pose `T_TC` (4, 4) of the eyes, or of the camera between them, in the torso frame. Axes of C: x to
        the right, y down, z where the robot looks."""
        return read_only(self._gaze.eyes(joints.position))

    @property
    def turns_gaze(self) -> str:
        """Name of the part that `look_at` turns: a head, or the torso of a robot without a neck; empty if
        the robot has neither."""
        return self._gaze.part

    def carried(self, part: str) -> frozenset[str]:
        """Names of the patches that a motion of `part` moves in space. Raises UnknownNameError for an unknown
        part."""
        return self._gaze.carried[self.robot.part(part).name]

    def nearest(self, perception: Perception, part: str, target: ArrayLike, point: ArrayLike) -> Array:
        """How near the skin that `part` carries along comes to `point` (3,) [m] in the torso frame, which
        stays where it is in space, on the way to `target` (n,) [rad]: distances (k,) [m] at equal steps of
        the way, from here to the target; infinite if it carries none."""
        goal, place = np.asarray(target, np.float64), np.asarray(point, np.float64)
        return self._gaze.nearest(_joints(perception).position, self.robot.part(part).name, goal, place)

    def distance(self, contact: Contact, landmark: Landmark) -> float:
        """Geodesic distance [m] along the skin between a contact and a landmark of its part; infinite if they
        are on different patches."""
        return self.distances(contact, [landmark])[0]

    def distances(self, contact: Contact, landmarks: Sequence[Landmark]) -> list[float]:
        """`distance` to several landmarks, in less time."""
        return self._landmarks.distances(contact, landmarks)

    def calibrated(self, patch: str) -> bool:
        """Whether the forces of a patch were measured (`tci skin calibrate`), not taken from its description.

        Raises UnknownNameError for an unknown patch.
        """
        return self.layout.patches[self.layout.places[self.robot.patch(patch).name]].calibration is not None

    def counts(self, contact: Contact) -> float:
        """By how many counts the taxels of a contact are away from rest, summed; 0 without taxels. By the
        description's response, so it says nothing of a calibrated patch."""
        patch = self.layout.patches[self.layout.places[contact.patch]]
        pressure = contact.taxel_forces / patch.surface.areas[contact.taxels]
        return float(patch.description.sensor.counts(pressure).sum())

    def coverage(
        self, perception: Perception, part: str, places: Sequence[LimbPlace | Landmark], radius: ArrayLike
    ) -> Array:
        """Returns, for each place of a part, the fraction (m,) of trusted taxels among the taxels within
        `radius` (m,).

        If there are no taxels around a place, its fraction is 1. The radius around a `LimbPlace` is in limb
        lengths; the radius around a `Landmark` is a geodesic distance [m].
        """
        masked = None if perception.skin is None else perception.skin.masked
        if masked is None:
            return np.ones(len(places))
        return self._coverage.shares(masked, _joints(perception), part, places, np.asarray(radius))

    def support(self, perception: Perception, leg: str, target: ArrayLike) -> Support:
        """Returns the forces on the soles now, and the stability margin after a motion of `leg` to generic
        angles `target` (n,) [rad]."""
        position = _joints(perception).position
        return self._stability.support(perception.contacts, position, leg, np.asarray(target, np.float64))

    def to_platform(
        self, orders: Iterable[Order] | Order, joints: JointReading
    ) -> tuple[list[PlatformOrder], list[Reason]]:
        """Converts generic orders to commands for the robot's own joints (inverse of eqs. 1-2). `joints`
        contains the present angles of these joints.

        Returns the converted orders, and a reason for each order that can't be converted. Raises
        UnknownNameError for an unknown part.
        """
        platform: list[PlatformOrder] = []
        refused: list[Reason] = []
        for order in (orders,) if isinstance(orders, Order) else orders:
            try:
                platform.append(order_to_platform(self.robot, order, joints.position))
            except CommandError as error:
                refused.append(error.reason)
        return platform, refused


def slowed(rates: ArrayLike, into: Array, most: ArrayLike) -> Array:
    """The speeds (n,) [rad/s] nearest to `rates` (n,) with which no speed `into` (c, n) @ rates is above
    `most` (c,). If not all are possible, the largest excess is as small as 20 corrections make it."""
    speeds, limits = np.array(rates, np.float64), np.asarray(most, np.float64)
    sizes = (into**2).sum(axis=1) + 1e-4
    for _ in range(20):
        excess = into @ speeds - limits
        worst = int(excess.argmax())
        if excess[worst] <= 1e-6:
            break
        speeds -= into[worst] * excess[worst] / sizes[worst]
    return read_only(speeds)


def order_to_platform(robot: Robot, order: Order, position: Array) -> PlatformOrder:
    """Converts one order to an order for the robot's own joints, whose present angles are `position`
    (n_servos,) [rad].

    An order that already is in the robot's own joints is returned unchanged. Raises CommandError if the order
    can't be converted.
    """
    match order:
        case GenericCommand():
            return to_platform(robot, order, position=position)
        case PlatformCommand() | PlatformSwitch():
            return order
        case SwitchMode():
            return switch(robot, order)
        case ExpectContact():
            return expected(robot, order)
        case CartesianCommand():
            return cartesian_to_platform(robot, order, position)


def _joints(perception: Perception) -> JointReading:
    """Returns the reading of the robot's own joints. Raises TciError for a perception without this
    reading."""
    if perception.joints is None:
        raise TciError("a perception without joints; valid: one that a tci.Perceiver made")
    return perception.joints
