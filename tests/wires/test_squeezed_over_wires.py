"""Whom an arm squeezes is freed through a genuine wire, too, in real time."""

from __future__ import annotations

import pytest

from helpers.squeezed import By, squeeze
from helpers.squeezed_over_a_wire import squeeze_over
from helpers.squeezes import draw
from helpers.wire_peers import wire
from tci.gate.settings import GateSettings
from tci.robot.catalogue import load_robot

pytestmark = pytest.mark.live


@pytest.mark.parametrize(
    ("middleware", "name", "seed", "by", "answers"),
    [
        ("yarp", "icub", 9, "gesture", False),
        ("unitree", "g1", 7, "gesture", False),
        ("zenoh", "icub", 24, "order", True),
    ],
)
def test_whom_an_arm_squeezes_is_freed(middleware: str, name: str, seed: int, by: By, answers: bool) -> None:
    """On YARP and Unitree's DDS the gate of this process answers, over Zenoh that of `tci serve`."""
    trial = draw(load_robot(name), seed, by=by, below=by == "gesture")
    left = squeeze(load_robot(name), trial, settings=GateSettings(contact=None))
    assert left.late > 30.0, "this trial shows nothing"
    with wire(middleware) as via:
        freed, result = squeeze_over(via, name, trial, answers=answers)
    assert freed.first is not None
    assert freed.half <= 65.0
    assert freed.late <= (15.0 if freed.felt else 30.0)
    assert result.went_back
