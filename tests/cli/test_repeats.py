"""A run prints at most one line for each cause and second, with the number of repeats and the worst case."""

from __future__ import annotations

import numpy as np

from tci.cli.repeats import Repeats
from tci.cli.run_log import Event


def shown(events: list[Event], end: float) -> list[Event]:
    lines: list[Event] = []
    repeats = Repeats(lines.append)
    for event in events:
        repeats.add(event)
    repeats.pass_time(end)
    repeats.end()
    return lines


def test_a_hold_that_flickers_for_two_minutes_is_a_line_a_second_with_count_and_worst_case() -> None:
    rng = np.random.default_rng(0)
    events, age = [], {}
    for place, now in enumerate(np.arange(0.0, 120.0, 0.09)):
        age[now] = float(rng.integers(51, 400))
        events.append(Event(now, "HOLD", f"joint data are {age[now]:.0f} ms old (the robot stops)"))
        events.append(Event(now + 0.03, "at rest", f"all servos are commanded to rest after {place} ms"))
        events.append(Event(now + 0.05, "RUN", "no fault any more (commands pass)"))
    lines = shown(events, 121.0)
    for kind in ("HOLD", "at rest", "RUN"):
        own = [line for line in lines if line.kind == kind]
        assert len(own) <= 121
        counts = [int(line.words.split()[0]) if "more times" in line.words else 1 for line in own]
        assert sum(counts) == len(age), "nothing is lost"
    told = [line.words for line in lines if line.kind == "HOLD"]
    assert any(f"{max(age.values()):.0f} ms old" in words for words in told), "the worst case is among them"


def test_the_first_of_a_cause_another_cause_and_every_stop_are_shown_at_once() -> None:
    events = [
        Event(0.0, "HOLD", "joint data are 51 ms old"),
        Event(0.1, "HOLD", "the skin of left_forearm is silent"),
        Event(0.2, "STOP", "jumped by 3 degrees"),
        Event(0.3, "STOP", "jumped by 4 degrees"),
        Event(0.4, "HOLD", "joint data are 60 ms old"),
    ]
    lines: list[Event] = []
    repeats = Repeats(lines.append)
    for event in events:
        repeats.add(event)
    assert lines == events[:4]
    repeats.end()
    assert lines == events
