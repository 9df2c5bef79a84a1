"""Robot states in which commands are permitted, and network addresses over which a robot may be commanded."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tci.errors import DriverError
from tci.shared import interfaces as network
from tci.wires.unitree.address import parse_unitree
from tci.wires.unitree.health import Health
from tci.wires.unitree.wire import STATE


def state(**changed: Any) -> Any:
    """Returns the state of a healthy G1 with other values in the fields `changed` of motor 3."""
    made: Any = np.zeros((), STATE)
    made["mode_machine"], made["quaternion"], made["crc"] = 5, (1, 0, 0, 0), 1
    made["motor"]["temperature"] = 30
    for name, value in changed.items():
        made["motor"][name][3] = value
    return made


def judged(made: Any, **options: Any) -> Health:
    health = Health(**options)
    health.see(made, True, 1.0)
    return health


def tilted(angle: float) -> Any:
    made = state()
    made["quaternion"] = np.cos(angle / 2), np.sin(angle / 2), 0, 0
    return made


def pressed(low: int, high: int) -> Any:
    made = state()
    made["remote"][2:4] = low, high
    return made


def turning(speed: float) -> Any:
    made = state()
    made["gyroscope"][2] = -speed
    return made


@pytest.mark.parametrize(
    ("made", "word"),
    [
        (state(motorstate=4), "left_knee_joint reports the error 4"),
        (state(q=np.nan), "left_knee_joint reports the angle nan"),
        (state(dq=-11.0), "left_knee_joint is faster than 10 rad/s: -11"),
        (state(temperature=(86, 30)), "casing above 85 C: 86"),
        (state(temperature=(30, 121)), "winding above 120 C: 121"),
        (tilted(1.1), "tilted by 1.10 rad"),
        (turning(6.5), "turns at 6.5 rad/s"),
        (pressed(1 << 5, 1 << 1), r"L2\+B on the remote"),
    ],
)
def test_a_fault_of_the_robot_is_named_and_lasts(made: Any, word: str) -> None:
    health = judged(made)
    assert re.search(word, health.lasting)
    health.see(state(), True, 1.1)
    assert re.search(word, health.lasting)


@pytest.mark.parametrize(
    "made",
    [
        state(),
        state(dq=9.9, temperature=(85, 120)),
        tilted(0.9),
        turning(5.9),
        pressed(1 << 5, 0),
        pressed(0, 2),
    ],
)
def test_a_healthy_robot_has_no_fault(made: Any) -> None:
    health = judged(made)
    assert not health.lasting
    assert not health.passing(1.05)
    assert "150 ms old" in health.passing(1.15)


def test_an_angle_that_is_none_does_not_become_a_target() -> None:
    made = state(q=0.4)
    health = judged(made)
    health.see(state(q=np.nan), True, 1.1)
    assert health.lasting
    assert health.posture[3] == np.float32(0.4)


def test_wrong_checksums_are_not_used() -> None:
    health = Health()
    assert not health.see(state(), False, 1.0)
    assert "1 with a wrong checksum" in health.passing(1.0)


def test_only_a_simulation_may_leave_out_checksum_and_variant() -> None:
    made = state()
    made["mode_machine"] = made["crc"] = 0
    assert not Health().see(made, False, 1.0)
    health = Health(simulation=True)
    assert health.see(made, False, 1.0)
    assert not health.lasting
    assert "mode_machine 0; valid: 4 (23 motors), 5 (29 motors), 6 (27 motors)" in judged(made).lasting


def test_variants_are_told_apart_and_do_not_change() -> None:
    made = state()
    made["motor"]["motorstate"][13] = 9
    made["mode_machine"] = 6  # the waist of this variant is fixed, so motor 13 does not exist
    health = judged(made)
    assert not health.lasting
    made = state()
    health.see(made, True, 1.1)
    assert "mode_machine has changed from 6 to 5" in health.lasting


def fake(tmp_path: Path, *, wireless: bool = False, default: bool = False) -> dict[str, Path]:
    """Returns folders that describe a machine with the network interface `cable`."""
    (tmp_path / "net" / "cable").mkdir(parents=True)
    if wireless:
        (tmp_path / "net" / "cable" / "wireless").mkdir()
    target = "00000000" if default else "007BA8C0"
    (tmp_path / "route").write_text(f"Iface\tDestination\tGateway\ncable\t{target}\t00000000\n")
    return {"classes": tmp_path / "net", "routes": tmp_path / "route"}


def test_only_a_private_cable_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    network.check_interface("cable", **fake(tmp_path / "1"))
    for options, word in (({"wireless": True}, "wireless"), ({"default": True}, "default route")):
        places = fake(tmp_path / word, **options)
        with pytest.raises(DriverError, match=f"{word}.*no authentication"):
            network.check_interface("cable", **places)
        network.check_interface("cable", force=True, **places)
    with pytest.raises(DriverError, match="no network interface wire; valid: cable"):
        network.check_interface("wire", force=True, **places)
    monkeypatch.setattr(network, "address_of", lambda name: network.IPv4Address("8.8.8.8"))
    with pytest.raises(DriverError, match=r"public address 8\.8\.8\.8"):
        network.check_interface("cable", **fake(tmp_path / "2"))


def test_an_address_names_the_interface() -> None:
    assert str(parse_unitree("lo/7")) == "lo/7"
    assert parse_unitree("", usual="lo").domain == 0
    assert parse_unitree("lo").topic == "rt/arm_sdk"
    assert parse_unitree("lo?control=all").topic == "rt/lowcmd"
    for wrong, word in (
        ("", "interface of the robot's cable is missing"),
        ("lo/233", "lo/233"),
        ("lo/x", "valid: INTERFACE"),
        ("lo?control=legs", "control=legs"),
        ("lo?hurry=yes", "hurry=yes"),
        ("no_such", "no network interface no_such"),
    ):
        with pytest.raises(DriverError, match=word):
            parse_unitree(wrong)
