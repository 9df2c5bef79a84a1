"""Perceives readings of one robot: the half of the interface that leads up (Fig. 2, L3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

from tci.body.generic_body import GenericBody
from tci.frames import Array
from tci.messages import Contact, Perception, Reading, SkinFrame
from tci.skin.conditioning import PatchHealth
from tci.skin.contact_table import identities
from tci.skin.contacts import find_contacts
from tci.skin.live_skin import LiveSkin
from tci.skin.send_on_delta import HoldLast
from tci.skin.tracking import Tracker


class Perceiver:
    """Turns the readings of one robot into perceptions. The only object of the interface that changes.

    It holds baselines, estimation windows and tracks of contacts, and has one owner. `copy` branches,
    pickling keeps everything, and the same readings give the same perceptions bit for bit.
    """

    def __init__(self, body: GenericBody, *, keep_alive: float | None = None) -> None:
        """With a `keep_alive` [s] the senders of skin frames send changes only, each patch at least once in
        that time; None: every frame. The perceptions are the same.

        Raises TciError for a calibration that does not fit the robot, or another `keep_alive`.
        """
        self.body = body
        self._held = None if keep_alive is None else HoldLast(body.robot, keep_alive)
        settings = body.settings
        self._skin = LiveSkin(
            body.robot, conditioning=settings.conditioning, calibration=settings.calibration, skin=body.skin
        )
        self._frames: tuple[SkinFrame, ...] = ()
        self._patches = self._skin.felt
        self._contacts: Sequence[Contact] = ()
        self._tracker = Tracker()

    def step(self, reading: Reading, now: float) -> Perception:
        """Perceives one reading at time `now` [s] (eqs. 1-4, 7).

        Raises FrameError, and changes nothing, if a frame or the joints do not fit the robot.
        """
        posture = self.body.posture(reading.joints)
        frames = reading.skin
        if self._held is not None:
            frames = self._held.fill(frames, now)
            reading = replace(reading, skin=frames)
        ended: tuple[int, ...] = ()
        if frames != self._frames:
            self._skin.update(reading)
            self._frames = frames
        if self._skin.felt is not self._patches:
            ended = self._find(posture)
        else:
            self._skin.learn()
        return Perception(now, posture, self._contacts, ended, self._skin.state, reading.joints)

    def copy(self) -> Perceiver:
        """Another one that goes on from here on its own."""
        return deepcopy(self)

    @property
    def counts(self) -> dict[str, int]:
        """Values and frames not used until now: `values_dropped` and `frames_late`."""
        return self._skin.counts

    @property
    def health(self) -> dict[str, PatchHealth]:
        """Trusted share of each patch, by its name."""
        return self._skin.health

    def rezero(self, patch: str) -> None:
        """Takes the present values of a patch for its rest. Raises UnknownNameError for an unknown patch."""
        self._skin.rezero(patch)

    def _find(self, posture: Mapping[str, Array]) -> tuple[int, ...]:
        """Finds contacts, once per skin frame; the identities of those that are gone."""
        before = identities(self._contacts)
        self._contacts = find_contacts(
            self._skin, self._skin.state, posture, settings=self.body.settings.contacts, tracker=self._tracker
        )
        self._patches = self._skin.felt
        now = identities(self._contacts)
        return () if before == now else tuple([int(one) for one in before if one not in now])
