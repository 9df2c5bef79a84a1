from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from helpers.recorded import equal_readings, record_poke
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.registry import connect
from tci.drivers.replay import ReplayDriver, changed_versions
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, RecordingError
from tci.reasons import Code, Reason
from tci.recording.growing import GrowingMcap
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import decode, encode
from tci.recording.schemas import DECISION
from tci.robot.catalogue import load_robot
from tci.runtime.loop import Tick, run

REPLAY = """
import sys, tci
from tci.runtime.loop import run
with tci.connect(tci.load_robot(sys.argv[1]), "replay:" + sys.argv[2]) as driver:
    run(driver, tci.WithdrawalReflex())
    print(driver.compared, len(driver.different))
"""


@pytest.mark.parametrize("robot", ["nao", "icub"])
def test_another_process_decides_the_same_bit_for_bit(robot: str, tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", robot=robot)
    assert any(tick.commands for tick in ticks), "the reflex answered"
    found = subprocess.run(
        [sys.executable, "-c", REPLAY, robot, str(tmp_path / "a.mcap")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.split() == [str(len(ticks)), "0"]


def test_a_skin_that_sends_changes_only_decides_the_same(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", keep_alive=0.25)
    with ReplayDriver(load_robot("nao"), str(tmp_path / "a.mcap")) as driver:
        assert driver.info.keep_alive == 0.25
        seen: list[Tick] = []
        run(driver, WithdrawalReflex(), observe=seen.append)
        assert (driver.compared, driver.different) == (len(ticks), [])
    for again, tick in zip(seen, ticks, strict=True):
        assert again.skin.active.tolist() == tick.skin.active.tolist()
        assert again.skin.pressure.tolist() == tick.skin.pressure.tolist()


def test_a_replay_that_ends_in_motion_is_not_brought_to_rest(tmp_path: Path) -> None:
    """Nothing moves at the end of a replay. Stop commands would be compared with the recorded decisions, and
    would consume readings that are left."""
    ticks = record_poke(tmp_path / "a.mcap")
    moving = next(i for i, tick in enumerate(ticks) if tick.sent.velocity.any()) + 20
    assert ticks[moving].sent.velocity.any()
    with ReplayDriver(load_robot("nao"), str(tmp_path / "a.mcap")) as driver:
        run(driver, WithdrawalReflex(), duration=ticks[moving].now - ticks[0].now)
        assert (driver.compared, driver.different) == (moving, [])
        assert driver.gate.counts.holds == 0


def test_a_replay_has_the_period_of_then(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", rate=100.0)
    assert any(tick.commands for tick in ticks)
    with ReplayDriver(load_robot("nao"), str(tmp_path / "a.mcap")) as driver:
        assert driver.period == driver.gate.period == 0.01
        run(driver, WithdrawalReflex())
        assert (driver.compared, driver.different) == (len(ticks), []) == (60, [])


def test_what_decides_the_bits_is_named(tmp_path: Path) -> None:
    record_poke(tmp_path / "a.mcap", duration=0.02)
    with ReplayDriver(load_robot("nao"), str(tmp_path / "a.mcap")) as driver:
        assert driver.changed == []
    then = '{"numpy": "1.0", "mcap": 7, "else": "1"}'
    assert [words.split(", here ")[0] for words in changed_versions(then)] == ["numpy 1.0", "mcap 7"]
    assert changed_versions("[1") == changed_versions("[1]") == changed_versions("") == []


def test_the_loop_sees_what_it_saw(tmp_path: Path) -> None:
    ticks = record_poke(tmp_path / "a.mcap", duration=0.1)
    seen: list[Tick] = []
    with connect(load_robot("nao"), f"replay:{tmp_path / 'a.mcap'}") as driver:
        run(driver, WithdrawalReflex(), observe=seen.append)
    assert [tick.now for tick in seen] == [tick.now for tick in ticks]
    assert all(equal_readings(a.reading, b.reading) for a, b in zip(seen, ticks, strict=True))


def test_other_settings_show_what_would_have_happened(tmp_path: Path) -> None:
    record_poke(tmp_path / "a.mcap")
    deaf = WithdrawalReflex(fields=())
    with ReplayDriver(load_robot("nao"), str(tmp_path / "a.mcap")) as driver:
        run(driver, deaf)
    answered = next(tick.now for tick in Recording(tmp_path / "a.mcap").ticks() if tick.commands)
    assert driver.different
    assert driver.different[0] == pytest.approx(answered)


def test_58_a_replay_reaches_nothing_and_takes_only_its_own_robot(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    record_poke(path, duration=0.05)
    with pytest.raises(DriverError, match="recorded from 'nao'"):
        ReplayDriver(load_robot("icub"), str(path))
    with (
        ReplayDriver(load_robot("nao"), str(path), arm=False) as driver,
        pytest.raises(DriverError, match="read-only"),
    ):
        run(driver, WithdrawalReflex())
    assert driver.compared == 0


def test_what_can_not_be_replayed_is_told(tmp_path: Path) -> None:
    robot = load_robot("nao")
    with pytest.raises(DriverError, match="valid: replay:FILE"):
        ReplayDriver(robot)
    with pytest.raises(DriverError, match="can't be read"):
        ReplayDriver(robot, str(tmp_path / "none.mcap"))
    (tmp_path / "a.mcap").write_text("hello, this is not a recording at all")
    with pytest.raises(RecordingError):
        ReplayDriver(robot, str(tmp_path / "a.mcap"))


def with_decisions(source: Path, target: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Writes a copy of a recording with changed decisions."""
    recording = Recording(source)
    file = GrowingMcap(target, library="test")
    file.describe("tci", recording.about)
    for topic, kind, stamp, data in recording.messages():
        if kind is DECISION:
            data = encode(kind, [*change(decode(kind, data)).values()])
        file.put(topic, kind, stamp, data)
    file.finish()
    file.close()


@pytest.mark.parametrize(("field", "counts"), [("text", False), ("code", True), ("number", True)])
def test_a_replay_compares_codes_and_numbers_and_no_text(field: str, counts: bool, tmp_path: Path) -> None:
    driver = SimulatedDriver(load_robot("nao"))
    with driver, Recorder(tmp_path / "a.mcap", driver.robot, period=driver.period) as recorder:
        driver.gate.stop(Reason(Code.SKIN_BLIND, "on purpose"))
        run(
            driver, WithdrawalReflex(), duration=0.04,
            observe=lambda tick: recorder.tick(tick.now, tick.reading, tick.commands, tick.sent),
        )  # fmt: skip

    def change(decision: dict[str, Any]) -> dict[str, Any]:
        assert decision["codes"].tolist() == [Code.SKIN_BLIND]
        changed = {"text": {"reason": "in other words"}, "code": {"codes": [Code.OTHER]},
                   "number": {"stamp": decision["stamp"] + 1e-12}}  # fmt: skip
        return {**decision, **changed[field]}

    with_decisions(tmp_path / "a.mcap", tmp_path / "b.mcap", change)
    with ReplayDriver(load_robot("nao"), str(tmp_path / "b.mcap")) as replay:
        replay.gate.stop(Reason(Code.SKIN_BLIND, "on purpose"))
        run(replay, WithdrawalReflex())
        assert replay.compared == 20
        assert len(replay.different) == (20 if counts else 0)


def test_a_recording_of_a_format_to_come_is_refused_by_its_number(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", load_robot("nao"), about={"format": "4"}):
        pass
    with pytest.raises(RecordingError, match="has format '4'; this version of TCI reads 1, 2, 3"):
        Recording(tmp_path / "a.mcap")
