"""`tci hand ROBOT` shows the pads of a simulated hand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from tci.cli.main import app
from tci.drivers.simulated import WorldClock
from tci.drivers.simulated_pads import SimulatedPads
from tci.robot.catalogue import load_robot


def test_the_pads_of_a_robots_simulated_hand_are_pressed_one_after_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tci.drivers.simulated_pads.PacedWorldClock", WorldClock)  # no wall clock
    source, most, order = SimulatedPads(load_robot("allegro")), dict[str, float](), list[str]()
    source.open()
    for _ in range(150):
        for sample in source.read():
            force = 1e-3 * float(np.sum(sample.values))
            most[sample.pad] = max(force, most.get(sample.pad, 0.0))
            if force > 1.0 and sample.pad not in order:
                order.append(sample.pad)
    assert order == list(source.pads)  # each finger, then the palm
    assert all(1.0 < force < 8.0 for force in most.values())
    shown = CliRunner().invoke(app, ["hand", "franka-hand", "--duration", "0.4", "--json"])
    assert [len(pad["values"]) for pad in json.loads(shown.stdout)["pads"].values()] == [25, 25, 25]
    asked = CliRunner().invoke(app, ["hand", "allegro", "--doctor"])
    assert "valid: tci view allegro, or the address of a hand" in str(asked.exception)
