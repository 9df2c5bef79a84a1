"""Tests `tci view`: its start, its end, and wrong arguments."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from matplotlib.image import imread

from helpers.command_line import tci
from helpers.recorded import record_poke
from helpers.touch_devices import InspireHand


def opened(*words: str) -> tuple[subprocess.Popen[str], str, str]:
    """Starts a command and waits until the command has printed the address of its page. Returns the process,
    the address, and the output."""
    command = [sys.executable, "-m", "tci.cli.main", *words]
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=_heed_ctrl_c
    )
    assert run.stdout is not None
    told = ""
    for line in run.stdout:
        told += line
        if found := re.search(r"open (http\S+)", line):
            return run, found[1], told
    raise AssertionError(told)


def _heed_ctrl_c() -> None:
    """Restores the default action of SIGINT, because processes in the background and their children ignore
    SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def ended(run: subprocess.Popen[str]) -> str:
    """Sends Ctrl-C and returns the output."""
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=60)
    assert run.returncode == 0, said
    return said


def test_the_page_of_two_robots_is_served_until_ctrl_c() -> None:
    run, address, _ = opened("view", "nao", "nao", "--port", "0", "--headless")
    with urllib.request.urlopen(address, timeout=30) as answer:
        assert b"<html" in answer.read().lower()
    assert "Traceback" not in ended(run)


def test_42_sigterm_closes_robots_and_page_first() -> None:
    run, _, _ = opened("view", "nao", "--port", "0", "--headless")
    run.send_signal(signal.SIGTERM)
    said, _ = run.communicate(timeout=60)
    assert run.returncode == 128 + signal.SIGTERM, said
    assert "Traceback" not in said


def test_the_demo_writes_table_picture_and_report_and_ends_in_the_viewer(tmp_path: Path) -> None:
    run, address, text = opened("demo", "nao", "--out", str(tmp_path), "--seed", "2", "--headless", "--view")
    with urllib.request.urlopen(address, timeout=30) as answer:
        assert answer.status == 200
    assert "Traceback" not in ended(run)
    assert "10 of 10 pokes answered by the reflex; the arm left the finger in 10" in text
    report = json.loads((tmp_path / "report.json").read_text())
    assert report.keys() == {"trials", "same_stimulus", "same_touch", "compared"}
    assert {
        "robot", "side", "site", "taxels", "responded", "trigger_ms", "first_motion_ms", "contact_lost_ms",
        "peak_force_n", "cop_error_mm", "withdrawn_mm", "withdrawn_without_reflex_mm", "limit_violations",
    } <= report["trials"][0].keys()  # fmt: skip
    same = report["same_stimulus"]
    assert same.keys() == {"max_generic_difference_rad", "hand_direction_deg", "hand_direction_torso_deg"}
    picture = imread(tmp_path / "demo.png")
    assert picture.shape[0] > 400
    assert picture.std() > 0.1


def test_a_recording_is_shown_without_naming_its_robot(tmp_path: Path) -> None:
    record_poke(tmp_path / "poke.mcap", duration=0.2)
    run, _, _ = opened("view", "--via", f"replay:{tmp_path / 'poke.mcap'}", "--port", "0", "--headless")
    assert "Traceback" not in ended(run)


def test_a_hand_alone_is_in_the_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BROWSER", "true")
    hand = InspireHand()
    hand.plug()
    try:
        time.sleep(0.1)
        run, address, _ = opened("hand", hand.via, "--view", "--port", "0")
        with urllib.request.urlopen(address, timeout=30) as answer:
            assert b"<html" in answer.read().lower()
        assert "Traceback" not in ended(run)
    finally:
        hand.unplug()


def test_a_duration_ends_it() -> None:
    assert "open http" in tci("view", "nao", "--port", "0", "--headless", "--duration", "0.5")


def test_mistakes_are_told() -> None:
    words = ("view", "nao", "--port", "0", "--headless")
    assert "2 --via for 1 robots" in tci(*words, "--via", "sim", "--via", "sim", status=1)
    assert "no capability named 'dance'" in tci(*words, "--run", "dance", status=1)
    assert "no such file" in tci(*words, "--via", "replay:/no/such.mcap", status=1).lower()
    assert "valid: a free port" in tci(
        *words[:3], "--headless", "--host", "203.0.113.1", "--port", "0", status=1
    )
