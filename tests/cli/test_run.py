"""Tests `tci run` with injected faults, and its output as text and as JSON."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.command_line import tci as told_by
from tci.body.generic_body import GenericBody
from tci.cli.run import run_capability
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, UnknownNameError
from tci.lab.faults.fault_list import FAULTS
from tci.lab.faults.injectors import INJECTORS
from tci.messages import Landmark, Order
from tci.robot.catalogue import load_robot
from tci.runtime.arguments import load_capability

POKED = ("run", "withdrawal", "nao", "--poke", "--duration", "0.7")


def kinds(told: dict[str, list[dict[str, str]]]) -> list[str]:
    return [event["kind"] for event in told["events"]]


def test_a_poke_is_answered() -> None:
    told = json.loads(told_by(*POKED, "--json"))
    assert told["worst"] == told["state"] == "run"
    assert kinds(told) == ["touch", "command"]
    assert told["faults"] == []
    assert told["loop"]["ticks"] == 350
    assert not told["loop"]["cut_short"]
    assert [*told["touched_N"]] == ["left_forearm"]
    assert max(told["moved_rad"].values()) > np.deg2rad(3.0)
    assert told["gate"]["refusals"] == 0


def test_a_poke_that_comes_after_the_end_is_told() -> None:
    early = ("run", "withdrawal", "nao", "--poke", "--duration", "0.2")
    words = "the simulated finger did not touch left_forearm: the run ended before; valid: --duration 1"
    assert words in told_by(*early, status=1)
    assert json.loads(told_by(*early, "--json", status=1))["missed_touches"][0].startswith(words)


def test_where_a_finger_meets_other_skin_first_it_says_that_it_reaches_none() -> None:
    """The sleeves of a NAO cover the switches on its hands: its forearm was poked, and its hand named."""
    told = told_by("run", "soft-hands", "nao", "--poke", "--duration", "0.5")
    assert "the simulated finger pokes left_forearm: it reaches no skin that soft-hands needs" in told
    assert "touched left_forearm" in told


class Idle(tci.Capability[None]):
    """Answers nothing."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        return (), None


def test_a_touch_that_the_capability_does_not_answer_is_said() -> None:
    words = " ".join(told_by("run", "cli.test_run:Idle", "nao", "--poke", "--duration", "0.5").split())
    assert "cli.test_run:Idle gave no command" in words
    assert "tci view nao --run cli.test_run:Idle" in words
    assert "gave no command" not in told_by(*POKED)


def test_a_poked_finger_is_half_bent_so_the_hand_lets_go() -> None:
    told = json.loads(told_by("run", "finger-reflex", "g1-inspire", "--poke", "--duration", "1.2", "--json"))
    assert "left_fingers lets go" in " ".join(event["words"] for event in told["events"])
    assert max(told["moved_rad"].values()) > np.deg2rad(20.0)


def test_a_run_that_ends_in_motion_says_so() -> None:
    told = json.loads(told_by(*POKED[:-1], "0.33", "--json"))
    assert told["worst"] == told["state"] == "run"
    assert kinds(told) == ["touch", "command", "at rest"]
    assert "the run ended during a motion" in told["events"][-1]["words"]
    assert told["loop"]["cut_short"]


def test_a_fault_that_stops_the_robot_is_told_and_the_status_says_so() -> None:
    told = json.loads(told_by(*POKED, "--fault", "stale-encoder@0.32", "--json", status=1))
    assert told["worst"] == told["state"] == "stop"
    assert kinds(told)[-3:] == ["FAULT", "STOP", "at rest"]
    fault, stop = told["events"][-3:-1]
    assert fault["time_s"] == pytest.approx(0.32, abs=0.005)
    assert "fault 20" in fault["words"]
    assert "expected: STOP" in fault["words"]
    assert "stands still" in stop["words"]
    (outcome,) = told["faults"]
    assert (outcome["fault"], outcome["answer"]) == ("stale-encoder", "STOP")
    assert outcome["after_s"] == pytest.approx(stop["time_s"] - 0.32, abs=0.005)
    assert "stands still" in outcome["why"]


def test_a_part_that_is_held_is_told_to_go_back() -> None:
    told = json.loads(told_by(*POKED, "--fault", "stall@0.32", "--json"))
    assert told["worst"] == told["state"] == "run"
    assert "CONTACT" in kinds(told)[kinds(told).index("FAULT") :]
    assert "met something" in " ".join(event["words"] for event in told["events"])
    assert ({one["code"] for one in told["went_back"]}, told["clamps"]) == ({"CONTACT"}, [])
    (outcome,) = told["faults"]
    assert (outcome["fault"], outcome["answer"]) == ("stall", "CONTACT")
    assert outcome["after_s"] < 0.3
    assert "met something" in outcome["why"]
    last = " ".join(told_by(*POKED, "--fault", "stall@0.32").split())
    assert last.endswith("a part met something; see what is in its way, then order the motion again")


def test_a_person_sees_what_happened_and_why_the_robot_holds() -> None:
    text = told_by(*POKED, "--fault", "dropped-frames@0.3:0.2")
    assert text.startswith("the simulated finger pokes left_forearm")
    assert "dropped-frames (fault 10: dropped frames)" in text
    held = text.index("HOLD")
    assert "ms old" in text[held:]
    assert "until the cause is gone" in text[held:]
    assert held < text.index("at rest") < text.index("over") < text.index("RUN", held), "it goes on"
    assert "HOLD 50 ms after dropped-frames" in " ".join(text[text.index("outcome") :].split())


class Nod(tci.Capability[None]):
    """Commands the head in every period."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        return (tci.GenericCommand("head", tci.Mode.POSITION, np.array([0.1, 0.0, 0.0])),), None


def test_what_is_refused_while_the_robot_is_away_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    run_capability("cli.test_run:Nod", "nao", duration=0.7, faults=["dropped-frames@0.1:0.5"], as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["gate"]["refusals"] > 100
    refused = [event["words"] for event in told["events"] if event["kind"] == "refused"]
    assert len(refused) == 1
    assert "ms old" in refused[0]


class Lost(Nod):
    """A capability whose command is refused in every period."""

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        return (tci.GenericCommand("head", tci.Mode.POSITION, np.array([np.nan, 0.0, 0.0])),), None


class Counts(Nod):
    """A capability that keeps its memory in itself."""

    steps = 0

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        self.steps += 1
        return (), None


class Far(Nod):
    """A capability whose command is clamped in every period."""

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], None]:
        return (tci.GenericCommand("head", tci.Mode.POSITION, np.array([1.5, 0.0, 0.0])),), None


def test_a_run_that_got_no_lesson_says_how_to_end_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        run_capability("teach", "nao", duration=0.1, lesson=tmp_path / "mine.csv")
    assert end.value.code == 1
    assert "valid: guide an arm, then tap another part" in " ".join(capsys.readouterr().out.split())


def test_a_capability_that_is_refused_in_every_period_is_told_and_ends_with_a_status(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(SystemExit) as end:
        run_capability("cli.test_run:Lost", "nao", duration=0.1, as_json=True)
    assert end.value.code == 1
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert [(one["count"], one["time_s"]) for one in told["refusals"]] == [(50, 0.0)]
    assert "pitch = nan; valid: finite numbers" in told["refusals"][0]["words"]
    assert kinds(told) == ["refused", "refused"]
    assert told["events"][-1]["words"].startswith("every command was refused")
    assert len(caplog.records) == 1, "it is logged for programs"
    assert captured.err == "", "and not told twice to a person"


def test_a_bad_habit_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    run_capability("cli.test_run:Counts", "nao", duration=0.1)
    assert "Counts keeps state in itself (steps), so the next run" in " ".join(
        capsys.readouterr().out.split()
    )
    run_capability("cli.test_run:Counts", "nao", duration=0.1, as_json=True)
    assert len(json.loads(capsys.readouterr().out)["advice"]) == 1


def test_a_warning_that_no_command_prints_itself_reaches_whoever_runs_it() -> None:
    code = """
import logging
from tci.cli.console import told_here

with told_here():
    logging.getLogger("tci.run").warning("a clamp, which the command prints")
    logging.getLogger("tci").warning("the skin is gone")
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stderr == "the skin is gone\n"


def test_clamps_are_told_as_refusals_are(capsys: pytest.CaptureFixture[str]) -> None:
    run_capability("cli.test_run:Far", "nao", duration=0.1, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert [one["count"] for one in told["clamps"]] == [50]
    assert kinds(told)[:2] == ["clamped", "command"]
    assert "HeadPitch: 1.50 rad (85.94 degrees) asked, clamped to" in told["events"][0]["words"]
    assert [*told["moved_rad"]] == ["HeadPitch"]
    run_capability("cli.test_run:Far", "nao", duration=0.1)
    text = " ".join(capsys.readouterr().out.split())
    assert "0.000 s clamped HeadPitch: 1.50 rad (85.94 degrees) asked" in text
    assert "nao: touched nowhere; moved HeadPitch" in text
    assert "clamped 50 x, first at 0.000 s: HeadPitch: 1.50 rad (85.94 degrees) asked" in text


def test_a_class_that_is_not_in_its_module_is_answered_with_those_that_are() -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"in cli.test_run named 'Nodd' \(did you mean 'Nod'\?\); valid: Idle, Nod, Lost",
    ):
        load_capability("cli.test_run:Nodd")


def test_a_module_that_is_not_found_is_answered_with_the_places_that_were_searched() -> None:
    with pytest.raises(CommandError, match=re.escape(f"searched: {Path.cwd()} and the installed packages")):
        load_capability("no_such_file:Nod")


def test_a_class_that_its_package_loads_on_first_use_is_found() -> None:
    load = "from tci.runtime.arguments import load_capability as load"
    code = f"{load}; print(load('tci:WithdrawalReflex').refractory)"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout == b"0.5\n"
    valid = r"(\w+, )*WithdrawalReflex\b"  # in case another test has loaded the module
    with pytest.raises(UnknownNameError, match=rf"did you mean 'WithdrawalReflex'\?\); valid: {valid}"):
        load_capability("tci:WithdrawalRefle")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("tci:Capability", "the class Capability lacks init and step; valid: a subclass that has them"),
        ("tci.capabilities.contact_stop:ContactStop", "needs settings: .*'inner'; valid: ContactStop"),
    ],
)
def test_a_class_that_cannot_be_made_as_it_is(name: str, words: str) -> None:
    assert re.fullmatch(f"tci: run: .*{words}.*\n", told_by("run", name, "nao", status=1))


def test_a_rehearsal_lasts_until_the_fault_can_show(tmp_path: Path) -> None:
    """Simulates a minute of a NAO that is commanded at 50 Hz, in about 20 s of real time."""
    folder = tmp_path / "nao"
    shutil.copytree(Path(load_robot("nao").source).parent, folder)
    slow = folder / "slow.xml"
    slow.write_text(
        '<generic_robot version="1" extends="robot.xml" name="slow">'
        '<binding middleware="sim" rate="50" stale_after="0.2"/></generic_robot>'
    )
    told = json.loads(told_by("demo", str(slow), "--fault", "dead-patch@5", "--json", status=1))
    (outcome,) = told["faults"]
    assert outcome["answer"] == "STOP"
    assert 59.0 < outcome["after_s"] < 62.0
    assert "is blind" in outcome["why"]
    assert kinds(told)[-3:] == ["MASK", "STOP", "at rest"]


def test_faults_can_be_combined_and_a_killed_thread_ends_it() -> None:
    told = json.loads(
        told_by(*POKED, "--fault", "nan-taxel@0.1", "--fault", "thread-fails@0.4", "--json", status=1)
    )
    assert kinds(told).count("FAULT") == 2
    assert "a thread failed on purpose; the robot was brought to rest" in told["events"][-1]["words"]


OWN = """import tci


class Fails(tci.Capability):
    def init(self, body: tci.GenericBody):
        return None

    def step(self, memory, perception, body):
        return {"no": "key"}["memory"]


class Forgets(Fails):
    def step(self, memory, perception, body):
        pass
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Fails", "KeyError: 'memory' (faulty_own.py, line 9)"),
        ("Forgets", "Forgets: step returned NoneType; valid: the pair (commands, memory)"),
    ],
)
def test_a_capability_that_fails_is_told_with_its_place(
    name: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "faulty_own.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(SystemExit):
        run_capability(f"faulty_own:{name}", "nao", duration=0.1, as_json=True)
    assert words in json.loads(capsys.readouterr().out)["events"][-1]["words"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "withdrawl", "nao"), "withdrawal"),
        (("run", "withdrawal", "naoo"), "did you mean 'nao'?"),
        (("run", "withdrawal", "nao", "--fault", "plague@1"), "stall"),
        (("run", "withdrawal", "nao", "--fault", "stal@1"), "did you mean 'stall'?"),
        (("run", "withdrawal", "nao", "--fault", "stall"), "NAME@TIME:DURATION"),
        (("run", "withdrawal", "nao", "--via", "nowhere"), "sim"),
    ],
)
def test_what_is_not_there_is_one_message_with_what_is(arguments: tuple[str, ...], words: str) -> None:
    text = told_by(*arguments, status=1)
    assert words in text
    assert "Traceback" not in text


def test_a_wrong_name_of_a_robot_is_said_before_any_loop_is_compiled() -> None:
    program = (
        "import sys\n"
        "from tci.cli.main import main\n"
        "sys.argv = ['tci', 'run', 'withdrawal', 'naoo']\n"
        "try:\n"
        "    main()\n"
        "finally:\n"
        "    print('tci.support.compiled' in sys.modules)\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "naoo" in run.stderr
    assert run.stdout == "False\n"


def test_the_list_of_faults() -> None:
    rows = json.loads(told_by("fault", "list", "--json"))
    assert [row["number"] for row in rows] == list(FAULTS)
    assert {name for row in rows for name in row["injectors"]} == set(INJECTORS)
    assert all(row["test"] for row in rows if row["state"] == "tested")
    text = told_by("fault", "list")
    assert all(name in text for name in ("stall", "dead patch", "tested"))
    assert "tci run withdrawal nao --poke --fault stall@0.5" in text


def test_why_a_touched_leg_stays_is_told_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def poke_the_shin(driver: Driver, capability: object) -> str:
        assert isinstance(driver, SimulatedDriver)
        place = GenericBody(driver.robot).landmark("left_leg", Landmark("shank", (1.0, 0.0, 0.0)))
        driver.world.finger.poke(place.patch, place.p_L, place.n_L)
        return place.patch

    monkeypatch.setattr("tci.cli.session.poke_skin", poke_the_shin)
    run_capability("body-withdrawal", "nao-whole", duration=0.4, poke=True, as_json=True)
    told = json.loads(capsys.readouterr().out)
    notes = [event["words"] for event in told["events"] if event["kind"] == "NOTE"]
    assert len(notes) == 1
    assert "left_leg was touched and does not move: the robot stands on its legs" in notes[0]
