"""Detects and tracks contacts through joint torques, and improves the forces of contacts on skin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tci.errors import TciError
from tci.joint_touch.estimator import Explanation, PartEstimator, unit_torques
from tci.joint_touch.observer import MomentumObserver, ObserverSettings, Residual
from tci.messages import Contacts, JointReading
from tci.messages.frames import Array
from tci.robot.joint_calibration import JointCalibration
from tci.skin.contacts import describe_touches
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin

AREA = 3e-4
"""Area [m2] of a contact that is detected through joint torques. Assumed: two fingertips, since joint torques
contain no information about the area."""
_NONE = Contacts.of(())


@dataclass(frozen=True, slots=True)
class JointTouchSettings:
    """Settings for the detection of touches through joint torques."""

    observer: ObserverSettings = field(default_factory=ObserverSettings)
    """Settings of the momentum observer: the speed of the observer, and the errors of the robot's model."""
    begin: float = 4.5
    """A contact begins if the distance of the residual (the external joint torques) from zero is at least
    this number [standard deviations]. Assumed: with a smaller value lighter touches are detected, but errors
    of the model also count as touches."""
    end: float = 3.0
    """A contact ends if the distance of the residual (the external joint torques) from zero is less than this
    number [standard deviations]."""
    skin: float = 1.0
    """Relative error of the forces that the skin measures. Assumed: the error may be as large as the force,
    for example if taxels are missing at the place of the touch."""

    def __post_init__(self) -> None:
        if not 0.0 < self.end <= self.begin < np.inf:
            values = f"end={self.end}, begin={self.begin}"
            raise TciError(f"joint touch: {values}; valid: 0 < end <= begin, both finite")
        if not 0.0 < self.skin < np.inf:
            raise TciError(f"joint touch: skin {self.skin}; valid: above 0 and finite")


@dataclass(frozen=True, slots=True, eq=False)
class _Touch:
    """Contact that is detected on one part through joint torques."""

    identity: int
    onset: float
    patch: int
    point: Array
    """Point (3,) [m], in the frame of the patch's link, at which this contact was first detected on this
    patch."""


class JointTouch:
    """Detects touches of one robot through joint torques.

    The object contains the momentum observer and the current contacts. On each part at most one contact is
    detected through joint torques, in addition to the contacts on skin. The identities of these contacts are
    -1, -2 and so on.
    """

    def __init__(
        self, skin: Skin, layout: SkinLayout, calibration: JointCalibration, settings: JointTouchSettings
    ) -> None:
        """Starts without contacts. Raises DescriptionError if the robot has no model with masses, and
        UnknownNameError if the model lacks the torso or the link of a tool."""
        robot = skin.robot
        self.layout, self.settings = layout, settings
        self._observer = MomentumObserver(robot, calibration, settings.observer)
        parts = dict.fromkeys(patch.part for patch in robot.patches if patch.through_joints)
        self._parts = [PartEstimator(robot, part, skin.surfaces, skin.kinematics) for part in parts]
        self._touches: dict[str, _Touch] = {}
        self._next = -1
        self._reading: JointReading | None = None
        self._residual: Residual | None = None
        self._on_skin = self.contacts = _NONE

    def step(
        self, joints: JointReading, posture: Mapping[str, Array], on_skin: Contacts, skin: Skin
    ) -> Contacts:
        """Returns the contacts on the skin, with forces improved by the joint torques, and the contacts that
        are detected through joint torques alone."""
        fresh = self._reading is None or joints.stamp != self._reading.stamp
        if not fresh and _frames(on_skin) == _frames(self._on_skin):
            return self.contacts
        if fresh:
            self._residual = self._observer.step(joints)
        self._reading, self._on_skin = joints, on_skin
        if self._residual is None:
            self._touches = {}
            self.contacts = on_skin
            return on_skin
        felt: dict[str, Explanation] = {}
        forces = np.array(on_skin.force)
        for estimator in self._parts:
            found = self._feel(estimator, self._residual, joints.position, forces, skin)
            if found is not None:
                felt[estimator.part] = found
        self._touches = {part: one for part, one in self._touches.items() if part in felt}
        weighed = _with_forces(on_skin, forces)
        if felt:
            own = self._described(felt, joints, posture, skin)
            weighed = Contacts.of(sorted([*weighed, *own], key=self._place)) if weighed else own
        self.contacts = weighed
        return weighed

    def _place(self, contact: object) -> int:
        return self.layout.places[contact.patch]  # type: ignore[attr-defined]  # a contact

    def _feel(
        self, estimator: PartEstimator, residual: Residual, position: Array, forces: Array, skin: Skin
    ) -> Explanation | None:
        """Returns the contact that is detected through the joint torques of one part; None if there is no
        such contact.

        `forces` (c,) [N] contains the forces of all contacts on skin. The forces of the contacts on this part
        are replaced by improved values.
        """
        rows, torques = [], []
        for row, contact in enumerate(self._on_skin):
            if contact.part == estimator.part:
                wrench = -np.concatenate([contact.n_L, np.cross(contact.p_L, contact.n_L)])[:, None]
                link = self.layout.patches[self.layout.places[contact.patch]].description.link
                torques.append(unit_torques(wrench, position, link, skin.kinematics)[:, 0])
                rows.append(row)
        found, left = estimator.weigh(residual, torques, forces[rows], self.settings.skin)
        forces[rows] = found
        least = self.settings.end if estimator.part in self._touches else self.settings.begin
        return estimator.explain(left, residual, position, skin.kinematics, least)

    def _described(
        self, felt: Mapping[str, Explanation], joints: JointReading, posture: Mapping[str, Array], skin: Skin
    ) -> Contacts:
        """Converts `felt`, the contacts that are detected through joint torques, by part, to one `Contacts`
        in the order of the robot's patches."""
        rows = sorted(felt.items(), key=lambda item: item[1].patch)
        poses = skin.kinematics.pose_array(joints.position, self.layout.links)
        made = describe_touches(
            self.layout, [(one.patch, one.taxel, one.force) for _, one in rows], poses, posture
        )
        made.rows["area"] = AREA
        made.rows["certainty"] = [one.certainty for _, one in rows]
        for row, (part, one) in enumerate(rows):
            touch, point = self._touches.get(part), made.rows["p_L"][row]
            if touch is None:
                touch = _Touch(self._next, joints.stamp, one.patch, point)
                self._next -= 1
            elif touch.patch != one.patch:
                touch = replace(touch, patch=one.patch, point=point)
            self._touches[part] = touch
            made.rows["identity"][row], made.rows["onset"][row] = touch.identity, touch.onset
            made.rows["displacement"][row] = np.linalg.norm(point - touch.point)
        count = len(self.layout.sites)
        stamp, sequence = np.full(count, joints.stamp), np.full(count, joints.sequence, np.int64)
        return Contacts(self.layout.sites, stamp, sequence, *made)


def _frames(contacts: Contacts) -> tuple[bytes, bytes]:
    """The frames in which contacts were found; what was found in the same frames is equal."""
    return contacts.stamp.tobytes(), contacts.sequence.tobytes()


def _with_forces(contacts: Contacts, forces: Array) -> Contacts:
    """Returns the contacts with their total forces replaced by `forces` (c,) [N].

    Each taxel keeps its fraction of the force of its contact.
    """
    if not len(contacts) or np.array_equal(forces, contacts.force):
        return contacts
    ratio = forces / contacts.force
    each = np.repeat(ratio, np.diff(contacts.begin))
    return contacts.changed(
        force=forces,
        peak=contacts.peak * ratio,
        f_T=contacts.f_T * ratio[:, None],
        taxel_force=contacts.taxel_force * each,
    )
