"""Perception of one robot: from readings of the driver to perceptions for capabilities (layer L3 in
the paper's Fig. 2)."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from math import isfinite

from tci.body.generic_body import GenericBody
from tci.errors import FrameError
from tci.joint_touch.contacts import JointTouch
from tci.messages import Contacts, Perception, Reading, SkinFrame
from tci.messages.frames import Array
from tci.robot.joint_calibration import joint_calibration
from tci.skin.conditioning import Conditioner, PatchHealth
from tci.skin.contacts import ContactFinder
from tci.skin.send_on_delta import HoldLast


class Perceiver:
    """Converts the readings of one robot to perceptions.

    The state of a perceiver consists of baselines, estimation windows and tracks of contacts. All other
    objects of the generic interface are immutable. Do not share a perceiver between loops: each loop needs a
    separate perceiver. `copy` and pickling preserve the whole state. Two perceivers that get equal readings
    return perceptions that are equal bit for bit.
    """

    def __init__(self, body: GenericBody, *, keep_alive: float | None = None) -> None:
        """Prepares a perceiver without estimates.

        Set `keep_alive` [s] to the longest time between two frames of a patch if senders omit unchanged skin
        frames. None means that senders send every frame. The omission does not change the perceptions. Raises
        TciError if `keep_alive` is not above 0 and finite.
        """
        self.body = body
        self._held = None if keep_alive is None else HoldLast(body.robot, keep_alive)
        self._conditioner = Conditioner(body.layout, body.settings.conditioning)
        self._finder = ContactFinder(body.layout, body.settings.contacts)
        self._frames: tuple[SkinFrame, ...] = ()
        # True if the previous step had frames: the estimates then do not wait for a step without frames.
        self._crowded = False
        self._felt: JointTouch | None = None
        if any(patch.through_joints for patch in body.robot.patches):
            own, settings = (
                joint_calibration(body.robot, body.settings.joint_calibration),
                body.settings.joints,
            )
            self._felt = JointTouch(body.skin, body.layout, own, settings)
        self._contacts = self._finder.contacts

    def step(self, reading: Reading, now: float) -> Perception:
        """Returns the perception of one reading at time `now` [s] (eqs. 1-4, 7).

        Raises FrameError if a frame or the joints do not fit the robot; the state is then unchanged.
        """
        posture = self.body.posture(reading.joints)
        if reading.skin != self._frames and not isfinite(sum([frame.stamp for frame in reading.skin])):
            for frame in reading.skin:
                if not isfinite(frame.stamp):
                    raise FrameError(f"{frame.patch}: a frame stamped {frame.stamp} s; valid: a finite time")
        frames = reading.skin if self._held is None else self._held.fill(reading.skin, now)
        try:
            perceived = frames != self._frames and self._conditioner.step(frames)
        except FrameError:
            if self._held is not None:
                self._held.undo()
            raise
        if perceived:
            self._find(posture, reading.joints.position)
        if not perceived or self._crowded:
            self._conditioner.update()
        self._crowded = bool(perceived)
        self._frames = frames
        before, self._contacts = self._contacts, self._finder.contacts
        if self._felt is not None:
            self._contacts = self._felt.step(reading.joints, posture, self._contacts, self.body.skin)
        ended = _ended(before, self._contacts)
        return Perception(now, posture, self._contacts, ended, self._conditioner.state, reading.joints)

    def copy(self) -> Perceiver:
        """Returns an independent copy of this perceiver with its present state."""
        return deepcopy(self)

    @property
    def counts(self) -> dict[str, int]:
        """Returns the number of values and frames rejected so far: `values_dropped` and `frames_late`."""
        return {"values_dropped": self._conditioner.dropped, "frames_late": self._conditioner.late}

    @property
    def health(self) -> dict[str, PatchHealth]:
        """Returns the health of each patch, by its name."""
        return self._conditioner.health

    def rezero(self, patch: str) -> None:
        """Uses the present raw values of a patch as its new rest values. Nothing should touch the patch
        during this call.

        Raises UnknownNameError for an unknown patch.
        """
        self._conditioner.rezero(patch)

    def _find(self, posture: Mapping[str, Array], position: Array) -> None:
        """Updates the contacts after new skin frames, for generic angles `posture` [rad] by part and servo
        angles `position` (n_servos,) [rad]."""
        conditioner = self._conditioner
        links, poses = self.body.layout.links, self.body.skin.kinematics.pose_array
        self._finder.find(conditioner.state, conditioner.estimates, lambda: poses(position, links), posture)


def _ended(before: Contacts, after: Contacts) -> tuple[int, ...]:
    """Returns the identities of the contacts in `before` that are not in `after`."""
    if before.identity.tobytes() == after.identity.tobytes():
        return ()
    now = {*after.identity.tolist()}
    return tuple([one for one in before.identity.tolist() if one not in now])
