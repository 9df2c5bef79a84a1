"""Perceptions that are computed from a recording equal those of the loop. Touches and latencies are found in
these perceptions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tci
from tci.body.places import find_place
from tci.drivers.simulated import SimulatedDriver
from tci.errors import RecordingError
from tci.recording.perceived import perceive, recorded_robot
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.recording.touches import find_touches
from tci.runtime.loop import Tick
from tci.skin.skin import Skin


class Poked:
    """A recording of a poke, and the readings of the loop."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.robot = tci.load_robot("nao")
        self.ticks: list[Tick] = []
        reflex = tci.WithdrawalReflex()
        site = reflex.fields[0]
        with (
            SimulatedDriver(self.robot) as driver,
            Recorder(path, self.robot, period=driver.period) as recorder,
        ):
            joints = driver.read().joints
            place = find_place(Skin(self.robot), "left_arm", site.segment, site.u, site.theta, joints)
            driver.world.finger.poke(place.patch, place.p_L, place.n_L, gap=0.02)

            def see(tick: Tick) -> None:
                self.ticks.append(tick)
                recorder.tick(tick.now, tick.reading, tick.commands, tick.sent)

            tci.run(driver, reflex, duration=0.6, observe=see)


@pytest.fixture(scope="module")
def poked(tmp_path_factory: pytest.TempPathFactory) -> Poked:
    return Poked(tmp_path_factory.mktemp("poked") / "poke.mcap")


def test_all_is_felt_again_to_the_bit(poked: Poked) -> None:
    periods = list(perceive(Recording(poked.path), poked.robot))
    assert len(periods) == len(poked.ticks)
    touched = 0
    for period, tick in zip(periods, poked.ticks, strict=True):
        assert period.now == tick.now
        for name in ("stamp", "sequence", "begin", "active", "pressure"):
            assert np.array_equal(getattr(period.skin, name), getattr(tick.skin, name), equal_nan=True)
        assert [c.force for c in period.perception.contacts] == [c.force for c in tick.perception.contacts]
        assert period.decision is not None
        assert np.array_equal(period.decision["position"], tick.sent.position)
        touched += bool(tick.perception.contacts)
    assert touched > 5


def test_a_touch_and_how_long_its_answers_took(poked: Poked) -> None:
    touches = find_touches(perceive(Recording(poked.path), poked.robot))
    assert [touch.part for touch in touches] == ["left_arm"]
    touch = touches[0]
    with_contact = [tick for tick in poked.ticks if tick.perception.contacts]
    commanded = [tick.now for tick in poked.ticks if tick.commands and tick.now >= touch.began]
    assert touch.began == with_contact[0].now
    assert touch.ended == with_contact[-1].now
    assert touch.commanded == commanded[0]
    assert touch.peak_force == max(sum(c.force for c in tick.perception.contacts) for tick in with_contact)
    start = next(tick.perception.posture["left_arm"] for tick in poked.ticks if tick.now == touch.began)
    moved = [
        tick.now for tick in poked.ticks
        if tick.now >= touch.began
        and np.abs(tick.perception.posture["left_arm"] - start).max() > np.deg2rad(0.5)
    ]  # fmt: skip
    assert touch.moved == moved[0]
    assert touch.moved > touch.commanded


def test_two_touches_are_told_apart(poked: Poked) -> None:
    periods = list(perceive(Recording(poked.path), poked.robot))
    later = [
        type(period)(period.now + 1.0, period.reading, period.perception, period.commands, period.decision)
        for period in periods
    ]
    assert len(find_touches([*periods, *later])) == 2


def test_a_gesture_of_another_part_is_no_response(poked: Poked) -> None:
    gesture = {"part": "right_arm", "values": [0.0] * 5}
    periods = [
        type(one)(one.now, one.reading, one.perception, [gesture], one.decision)
        for one in perceive(Recording(poked.path), poked.robot)
    ]
    (touch,) = find_touches(periods)
    assert touch.commands == {}
    assert touch.commanded is None


def test_only_the_recorded_description_will_do(poked: Poked) -> None:
    recording = Recording(poked.path)
    assert recorded_robot(recording) == poked.robot
    recording.about["description_sha256"] = "0" * 64
    with pytest.raises(
        RecordingError, match=r"another description of 'nao'.*give the description of that time as ROBOT"
    ):
        recorded_robot(recording)
    recording.about["robot"] = "../etc/robot.xml"
    with pytest.raises(RecordingError, match="give its description"):
        recorded_robot(recording)
    recording.about["robot"] = ""
    assert recorded_robot(recording) is None


def test_a_recording_of_a_robot_that_tci_does_not_know_says_what_to_give(tmp_path: Path) -> None:
    own = tci.load_robot("nao").model_copy(update={"name": "mine"})
    with Recorder(tmp_path / "a.mcap", own):
        pass
    with pytest.raises(RecordingError, match="recorded from 'mine', which is no robot of TCI; give the path"):
        recorded_robot(Recording(tmp_path / "a.mcap"))
