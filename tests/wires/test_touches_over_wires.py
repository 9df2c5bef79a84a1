"""A robot that `tci serve` simulates is touched by `tci touch`, and a behaviour feels it over the wire."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import tci as library
from helpers.command_line import tci
from helpers.served import Served, needs_qi
from helpers.wire_peers import wire
from tci.drivers.registry import connect
from tci.messages import Contact
from tci.touches import Touch, write_touches

STROKE = Touch("stroke", "left forearm 0.3..0.7", 0.6, force=3.0, speed=0.08)


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Other tests serve the same robot at the same time."""
    with TemporaryDirectory() as folder:  # pytest's own are too long for a socket's name
        monkeypatch.setenv("TCI_LEASES", folder)
        yield


def felt_over(robot: str, name: str, reach: str, *words: str) -> tuple[list[Contact], dict[str, Any]]:
    """What a behaviour feels over a wire while `tci touch` touches the robot in a process of its own: the
    strongest contact of each skin frame, and what the command said."""
    described, found = library.load_robot(robot), dict[float, Contact]()
    command = [sys.executable, "-m", "tci.cli.main", "touch", robot, "--via", name, *words, "--json"]
    with connect(described, reach) as driver:
        perceiver, touching = library.Perceiver(library.GenericBody(described)), None
        for now in driver.ticks():
            for contact in perceiver.step(driver.read(), now).contacts[:1]:
                found.setdefault(contact.stamp, contact)
            touching = touching or subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            if touching.poll() is not None:
                break
        assert touching is not None
        assert touching.stdout is not None
        with touching.stdout:
            told = json.loads(touching.stdout.read())
    return list(found.values()), told


@pytest.mark.parametrize("name", ["yarp", "ros2", "naoqi"])
def test_a_stroke_of_a_file_is_felt_over_the_wire(name: str, tmp_path: Path) -> None:
    if name == "naoqi":
        needs_qi()
    write_touches(tmp_path / "stroke.tsv", [STROKE])
    with wire(name) as via:
        one = Served("nao", via)
        try:
            reach = via.replace("naoqi:", "naoqi://") if name == "naoqi" else via.partition(",")[0]
            contacts, said = felt_over("nao", name, reach, "--touches", str(tmp_path / "stroke.tsv"))
        finally:
            one.kill()
    assert "touches" in said, said
    (told,) = said["touches"]
    assert (told["kind"], told["force_N"]) == ("stroke", 3.0)
    assert {contact.patch for contact in contacts} == {"left_forearm"}
    forces = np.array([contact.force for contact in contacts])
    steady = forces > 1.5
    assert np.median(forces[steady]) == pytest.approx(3.0, rel=0.15)
    assert told["felt_N"] == pytest.approx(np.median(forces[steady]), rel=0.1)
    times = np.array([contact.stamp for contact in contacts])[steady]
    places = np.array([contact.p_L for contact in contacts])[steady]
    apart, way = times[5:] - times[:-5], np.linalg.norm(places[5:] - places[:-5], axis=1)
    # stamps are real time, of which a busy machine simulates a part
    assert way.sum() / apart.sum() / told["of_real_time"] == pytest.approx(0.08, abs=0.02)


def test_a_nao_as_it_is_sold_feels_a_press_and_what_a_program_inserts() -> None:
    needs_qi()
    import qi

    with wire("naoqi") as via:
        one = Served("nao-plain", via)
        try:
            reach = via.replace("naoqi:", "naoqi://")
            felt, said = felt_over("nao-plain", "naoqi", reach, "press 'top of head' 4N 0.5s")
            assert {contact.patch for contact in felt} == {"head"}
            assert said["touches"][0]["felt_N"] > 0.0
            session = qi.Session()
            session.connect(via.replace("naoqi:", "tcp://"))
            memory, key = session.service("ALMemory"), "FrontTactilTouched"
            robot = library.load_robot("nao-plain")
            with connect(robot, reach) as driver:
                perceiver = library.Perceiver(library.GenericBody(robot))
                told = []
                for count, now in enumerate(driver.ticks()):
                    if count in (20, 60):
                        memory.insertData(key, 1.0 if count == 20 else 0.0)
                    contacts = perceiver.step(driver.read(), now).contacts
                    told.append([contact.patch for contact in contacts])
                    if count > 110:
                        break
            session.close()
            assert told[59] == ["head"]
            assert told[19] == told[-1] == []
            refused = tci("touch", "nao-plain", "stroke 'left forearm'", status=1)
            assert "nao-plain has no skin on 'left forearm'" in refused
            assert "top of head" in refused
        finally:
            one.kill()


def test_who_serves_nothing_to_touch_is_told_what_to_do() -> None:
    words = tci("touch", "talos", "press 'left forearm'", "--via", "zenoh", status=1)
    assert "serves talos over zenoh" in words
    assert "valid: tci serve talos --via zenoh" in words
    assert "nothing to do" in tci("touch", "talos", status=1)
