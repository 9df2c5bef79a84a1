"""Each control mode keeps its limits on a robot of rigid bodies that the gate knows only roughly.

The judge is `helpers.four_modes`, which takes nothing from the gate.
"""

from __future__ import annotations

import numpy as np
import pytest

from helpers.four_modes import FourModes, frozen, pushed
from helpers.gate_checks import LIMITS, PERIOD, make_robot, reading
from helpers.healthy import Healthy
from tci.errors import CommandError, UnknownNameError
from tci.gate.gate import Gate
from tci.messages import CONTROL_MODES, Mode, PlatformSwitch
from tci.reasons import Code
from tci.robot.catalogue import load_robot

ICUB = load_robot("icub")


@pytest.mark.parametrize(("rate", "seed"), [(200.0, 12), (500.0, 14)])
def test_hostile_torques_with_late_readings_keep_speeds_and_links_apart(rate: float, seed: int) -> None:
    """With the inertia torque limit / acceleration limit, true speeds were up to 8.5 times their limits, and
    links overlapped by 50 and 110 mm."""
    trial = FourModes(ICUB, Mode.TORQUE, seed, rate=rate)
    while trial.plant.time < 4.0:
        trial.step()
    assert trial.seen.faults(Mode.TORQUE) == []
    assert trial.seen.silences > 0
    assert trial.seen.speed > 0.8, "hostile enough"


@pytest.mark.parametrize(("mode", "seed"), [(Mode.POSITION, 1), (Mode.VELOCITY, 104)])
def test_nobody_accelerates_while_readings_are_overdue(mode: Mode, seed: int) -> None:
    """Kinetic energy grew to 1.23 and 1.29 of what it was at the last reading."""
    trial = FourModes(ICUB, mode, seed, rate=200.0)
    while trial.plant.time < 2.5:
        trial.step()
    assert trial.seen.faults(mode) == []
    assert trial.seen.silences > 0
    assert trial.seen.growth >= 1.0, "a joint moved when the readings ended"


@pytest.mark.parametrize("name", ["l_shoulder_pitch", "l_shoulder_yaw"])
def test_a_free_joint_becomes_fast_and_a_held_one_gets_its_torque(name: str) -> None:
    servo = next(one.index for one in ICUB.servos if one.name == name)
    fast, _ = pushed(ICUB, servo, held=False, seed=1)
    assert fast >= 0.8
    _, sent = pushed(ICUB, servo, held=True, seed=1)
    assert sent >= 0.5


@pytest.mark.parametrize("friction", [0.0, 0.05])
@pytest.mark.parametrize("share", [1.0, 0.2])
@pytest.mark.parametrize("name", ["l_shoulder_roll", "l_elbow"])
def test_20_an_encoder_that_freezes_at_rest_lets_its_joint_turn_little(
    name: str, share: float, friction: float
) -> None:
    """A shoulder turned by 147 degrees at 6.4 times its limit; asked for a fifth of its torque, for ever.
    With pushes that were taken back it was still 5.1 and 16 degrees."""
    servo = next(one.index for one in ICUB.servos if one.name == name)
    fast, way, reason = frozen(ICUB, servo, share=share, friction=friction)
    assert reason.startswith(f"the encoder of {name} stands still whatever the torque")
    assert fast <= 1.0
    assert way <= np.deg2rad(4.0 if friction else 10.0)


@pytest.mark.parametrize("mode", [Mode.IMPEDANCE, Mode.TORQUE])
def test_a_healthy_but_dirty_robot_at_full_speed_raises_no_alarm(mode: Mode) -> None:
    trial = Healthy(ICUB, mode, 7, rate=500.0)
    trial.run(3.0)
    assert not trial.alarms
    assert trial.moved > 3.0, "a robot that stands still shows nothing"


@pytest.mark.parametrize(("name", "seed"), [("nao", 0), ("nao", 104), ("talos", 0)])
def test_a_weight_in_the_hand_is_nobody_who_holds_the_arm(name: str, seed: int) -> None:
    """0.3 kg and 0.5 kg bend a NAO's elbow by up to 3.4 degrees, and it went back from nobody in six of six
    runs."""
    trial = Healthy(load_robot(name), Mode.POSITION, seed, rate=200.0)
    trial.run(3.0)
    assert not trial.alarms
    assert trial.moved > 3.0, "a robot that stands still shows nothing"


def test_a_declared_load_counts_where_the_hand_carries_it() -> None:
    gate = Gate(ICUB, period=PERIOD, stale_after=0.05)
    names = [one.name for one in ICUB.servos]
    before = gate._motion._torque._inertia
    gate.load("left_arm", 1.0, (0.05, 0.05, 0.1))
    gained = gate._motion._torque._inertia - before
    assert gained[names.index("l_wrist_yaw")] > 0.004
    assert gained[names.index("l_elbow")] > 0.01
    assert abs(gained[names.index("r_elbow")]) < 1e-9
    gate.load("left_arm", 0.0)
    np.testing.assert_allclose(gate._motion._torque._inertia, before)
    with pytest.raises(CommandError, match="valid: at least 0 kg"):
        gate.load("left_arm", -1.0)
    with pytest.raises(UnknownNameError):
        gate.load("tail", 1.0)


def test_without_masses_there_is_no_torque_mode() -> None:
    robot = make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)
    gate = Gate(robot.model_copy(update={"model": None}), period=PERIOD, stale_after=0.05)
    safe = gate.step(PlatformSwitch(np.array([2]), Mode.TORQUE), reading([0.0] * 6), 0.0)
    assert [one.code for one in safe.refusals] == [Code.LIMITS_UNKNOWN]
    assert "joint2 has no torque mode: no <model>" in safe.refusals[0].text
    assert "valid: a <model> with the masses of all links" in safe.refusals[0].text
