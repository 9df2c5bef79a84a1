"""Plots contain every peak between two drawn samples, and the latest sample."""

from __future__ import annotations

import numpy as np

from tci.gate.gate import GateState
from tci.lab.viewer.view import SAMPLE, WINDOW, History, View
from tci.messages import JointReading


def view(time: float, response: float = 0.0) -> View:
    joints = JointReading(time, 0, np.zeros(1), np.zeros(1))
    return View(time, joints, {"left_arm": np.array([time])}, {}, (), GateState.RUN, "", response)


def test_a_short_peak_is_kept_and_the_latest_is_shown() -> None:
    history = History()
    for number in range(100):
        history.add(view(0.01 * number, response=float(number == 52)))
    time, _, response, angles = history.series("left_arm")
    assert response.max() == 1.0
    assert (response > 0.0).sum() == 1
    assert 0.52 <= time[response.argmax()] <= 0.52 + SAMPLE
    assert np.all(np.diff(time) > 0.0)
    assert len(time) <= 0.99 / SAMPLE + 2
    assert time[-1] == angles[0, -1] == 0.99
    history.add(view(0.995, response=2.0))
    assert history.series("left_arm")[2][-1] == 2.0


def test_it_holds_the_last_seconds_and_begins_anew_when_time_runs_back() -> None:
    history = History()
    for time in np.arange(0.0, 3.0 * WINDOW, SAMPLE):
        history.add(view(float(time)))
    assert np.ptp(history.series("left_arm")[0]) <= WINDOW
    history.add(view(1.0))
    assert history.series("left_arm")[0].tolist() == [1.0]
    assert history.series("right_arm")[0].size == 0
