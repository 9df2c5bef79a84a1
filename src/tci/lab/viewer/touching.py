"""The simulated hands that people move on the page: with the mouse, or with two fingers on a tablet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.body.places import Place
from tci.errors import CommandError
from tci.lab.viewer.view import TouchingHand
from tci.messages import Contact
from tci.messages.frames import Array
from tci.simulation.live_touch import LiveTouch
from tci.simulation.world import World

STROKED = 0.015
"""Way [m] along the skin from which a touch is a stroke. Assumed: about a finger's width."""


class Touching:
    """For the thread that steps the world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._live: dict[object, _One] = {}

    def aim(self, finger: object, place: Place, force: float) -> None:
        """Begins a touch with a free hand, or goes on with it on the same patch. Raises CommandError if no
        hand is free, and the errors of `LiveTouch`."""
        one = self._live.get(finger)
        if one is not None:
            one.aim(place, force)
            return
        free = [hand for person in self._world.people for hand in person.hands if not hand.busy]
        if not free:
            raise CommandError("no hand is free: two can touch at a time")
        link = self._world.robot.patch(place.patch).link
        live = LiveTouch(free[0], link, place.p_L, place.n_L, force)
        self._live[finger] = _One(live, place, force, self._world.time)

    def lift(self, finger: object) -> str:
        """Lifts a hand. Returns what it did, in the words of `tci run --touch`; "" if it did nothing."""
        one = self._live.get(finger)
        if one is None:
            return ""
        one.live.leave()
        return one.words(self._world)

    def update(self) -> None:
        for finger, one in list(self._live.items()):
            one.live.update()
            if not one.live.busy:
                del self._live[finger]

    def seen(self, contacts: Sequence[Contact]) -> tuple[TouchingHand, ...]:
        """The hands at work, and what is felt of them: of those that do planned touches, on all skin."""
        live = {one.live.hand.name: one for one in self._live.values()}
        found = []
        for hand in (hand for person in self._world.people for hand in person.hands if hand.busy):
            one = live.get(hand.name)
            patch, tip = (None, hand.tip(hand.leads)) if one is None else (one.start.patch, hand.tip())
            felt = sum(contact.force for contact in contacts if patch in (None, contact.patch))
            found.append(TouchingHand(tip, hand.asked, hand.force, float(felt)))
        return tuple(found)


class _One:
    def __init__(self, live: LiveTouch, start: Place, force: float, begun: float) -> None:
        self.live, self.start, self.force, self._begun, self._way = live, start, force, begun, 0.0
        self._last: Array = start.p_L

    def aim(self, place: Place, force: float) -> None:
        if place.patch != self.start.patch:
            return  # the hand stays at the edge of the patch
        self.live.aim(place.p_L, place.n_L, force)
        self._way += float(np.linalg.norm(place.p_L - self._last))
        self._last, self.force = place.p_L, max(force, self.force)

    def words(self, world: World) -> str:
        lasted = max(world.time - self._begun, 0.1)
        taxels = world.surfaces[self.start.patch].positions
        taxel = int(np.argmin(np.linalg.norm(taxels - self.start.p_L, axis=1)))
        place = f"'{self.start.patch} taxel {taxel}'"
        if self._way < STROKED:
            return f"press {place} {self.force:.1f}N {lasted:.1f}s"
        return f"stroke {place} {self.force:.1f}N {100.0 * self._way / lasted:.0f}cm/s"
