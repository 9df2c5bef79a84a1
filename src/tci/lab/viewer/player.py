"""Shows a recording as views: plays, pauses, seeks, at any speed."""

from __future__ import annotations

import bisect
import time
from collections.abc import Callable

import numpy as np

from tci.body.places import Place
from tci.capabilities.fields import default_fields
from tci.errors import CommandError, RecordingError
from tci.gate.gate import GateState
from tci.lab.viewer.labels import moves, touched
from tci.lab.viewer.view import WINDOW, History, View
from tci.messages import GenericCommand
from tci.recording.perceived import Perceived, perceive
from tci.recording.recording import Recording
from tci.recording.touches import RecordedTouch, find_touches
from tci.robot.description import Robot

FINEST = 0.01
"""Smallest time [s] between two stored views. Assumed: shorter than the time between two pictures of the
page."""
REFLEX = "withdrawal"
"""Behaviour whose receptive fields are shown. The fields are also shown if the recording contains no name of
a behaviour."""
LONGEST = 600.0
"""Length [s] of the longest recording that can be played. All views are kept in memory. Assumed: the views of
a longer recording need too much memory."""


class Player:
    """Plays the recording of one robot. Other threads may read only `view`, `history` and `events`."""

    armed = False
    world = None
    ended = ""
    pokes = 0

    def __init__(
        self, recording: Recording, robot: Robot, *, progress: Callable[[float], None] = lambda now: None
    ) -> None:
        """Computes the perceptions of the recording again. During the computation, `progress` is called with
        the recorded time [s] up to which perceptions have been computed.

        Raises RecordingError if the recording has no periods or is too long.
        """
        self.robot = robot
        known = recording.about.get("capability", REFLEX) == REFLEX
        self.fields = default_fields() if known else ()
        """Receptive fields that are shown. A recording contains the name of its behaviour, but not the
        fields."""
        self.history = History()
        self.playing = False
        self.speed = 1.0
        """Speed of the playback [recorded seconds per second]."""
        self._views: list[View] = []
        self._happened: list[tuple[float, str]] = []
        self._keep(recording, progress)
        self._times = [view.time for view in self._views]
        self._index = 0
        self._time = self.begin
        self._before: float | None = None
        self.touches: tuple[RecordedTouch, ...]
        self.seek(self.begin)

    @property
    def begin(self) -> float:
        """Time [s] of the first view."""
        return self._times[0]

    @property
    def end(self) -> float:
        """Time [s] of the last view."""
        return self._times[-1]

    @property
    def view(self) -> View:
        """View at the present time of the recording."""
        return self._views[self._index]

    @property
    def time(self) -> float:
        """Present time [s] in the recording."""
        return self._time

    @property
    def events(self) -> list[tuple[float, str]]:
        """Events up to the present time, with their time [s] from the beginning."""
        return [(stamp - self.begin, words) for stamp, words in self._happened if stamp <= self._time]

    @property
    def loop_words(self) -> str:
        """Returns words that tell if the recording plays or is paused, and at which time."""
        state = "playing" if self.playing else "paused"
        return f"recorded; {state} at {self._time - self.begin:.2f} of {self.end - self.begin:.2f} s"

    def touch(self, finger: object, place: Place, *, force: float) -> None:
        """Raises CommandError."""
        raise CommandError(f"{self.robot.name} is recorded, so no hand can touch it; valid: --via sim")

    def let_go(self, finger: object) -> None:
        """Nothing touches a recording."""

    def play(self) -> None:
        """Starts to play. If the present time is the recording's end, plays the recording from the
        beginning."""
        if self._time >= self.end:
            self.seek(self.begin)
        self.playing, self._before = True, None

    def pause(self) -> None:
        """Stops at the present time."""
        self.playing = False

    def seek(self, moment: float) -> None:
        """Sets the present time to the recorded time that is nearest to a given time [s]. The plots then show
        the seconds before this time."""
        self._time = min(max(moment, self.begin), self.end)
        self._index = max(bisect.bisect_right(self._times, self._time) - 1, 0)
        self.history.clear()
        first = bisect.bisect_left(self._times, self._time - WINDOW)
        for view in self._views[first : self._index + 1]:
            self.history.add(view)

    def advance(self, now: float | None = None) -> None:
        """Advances the recording to the present time of the machine's clock, or to `now` [s] on this clock.
        Stops at the end."""
        now = time.monotonic() if now is None else now
        if self.playing and self._before is not None:
            before = self._index
            self._time = min(self._time + self.speed * (now - self._before), self.end)
            self._index = max(bisect.bisect_right(self._times, self._time) - 1, 0)
            for view in self._views[before + 1 : self._index + 1]:
                self.history.add(view)
            self.playing = self._time < self.end
        self._before = now

    def start(self) -> None:
        """Begins to play."""
        self.play()

    def close(self) -> None:
        """Does nothing, because a player has no open file."""

    def say(self, words: str) -> None:
        """Adds an event at the present time of the recording, such as the reply to a person's click."""
        bisect.insort(self._happened, (self._time, words))

    def poke(self, place: Place, *, force: float, speed: float) -> None:
        """Raises CommandError: a recorded robot can't be touched."""
        raise CommandError("a recording can't be poked; valid: a simulated robot (tci view nao)")

    def _keep(self, recording: Recording, progress: Callable[[float], None]) -> None:
        periods, patches = [], [patch.name for patch in self.robot.patches]
        state: tuple[str, str] = ("", "")
        felt: set[str] = set()
        last = -np.inf
        for period in perceive(recording, self.robot):
            if self._views and period.now - self._views[0].time > LONGEST:
                raise RecordingError(
                    f"{recording.path} is longer than {LONGEST:g} s; valid: a part of it (tci log cut)"
                )
            decision = period.decision
            now_state = (decision["state"], decision["reason"]) if decision else ("", "")
            if now_state[0] != state[0] and state[0]:
                words = now_state[1] or "commands pass again"
                self._happened.append((period.now, f"{now_state[0].upper()}: {words}"))
            now_felt = {contact.part for contact in period.perception.contacts}
            news = now_state != state or now_felt != felt or not self._views
            if news or period.now - last >= FINEST - 1e-9:
                self._views.append(_view(period, patches))
                last = period.now
            state, felt = now_state, now_felt
            periods.append(period)
            progress(period.now)
        if not self._views:
            raise RecordingError(
                f"{recording.path} has no complete period; valid: a recording of a run (tci log info)"
            )
        self.touches = tuple(find_touches(periods))
        self._list_events(periods)

    def _list_events(self, periods: list[Perceived]) -> None:
        by_time: dict[float, list[Perceived]] = {}  # contact lists have several periods of one time
        for period in periods:
            by_time.setdefault(period.now, []).append(period)
        for touch in self.touches:
            seen = [contact for period in by_time[touch.began] for contact in period.perception.contacts]
            contacts = [contact for contact in seen if contact.part == touch.part]
            self._happened.append((touch.began, touched(contacts[0], self.fields, self.robot.switches)))
            if touch.commanded is not None:
                for command in [one for period in by_time[touch.commanded] for one in period.commands]:
                    if command["kind"] == GenericCommand.__name__ and command["part"] == touch.responding:
                        self._happened.append((touch.commanded, moves(touch.responding, command["values"])))
                        break
        self._happened.sort()


def _view(period: Perceived, patches: list[str]) -> View:
    decision = period.decision
    states = {state.value: state for state in GateState}
    return View(
        time=period.now,
        joints=period.reading.joints,
        posture=period.perception.posture,
        pressure=period.skin.by_patch(patches),
        contacts=period.perception.contacts,
        state=states.get(decision["state"]) if decision else None,
        reason=decision["reason"] if decision else "",
        response=float(np.abs(decision["velocity"]).max(initial=0.0)) if decision else 0.0,
    )
