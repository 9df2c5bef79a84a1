"""The momentum observer estimates external torques of an arm, with known and with unknown model, friction and
tools."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import tci
from helpers.bare_body import bare_body
from helpers.pushed_arm import ARM, PERIOD
from tci.errors import TciError, UnknownNameError
from tci.joint_touch.observer import MomentumObserver, ObserverSettings
from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.robot.dynamics import Dynamics
from tci.robot.gravity import STANDARD_GRAVITY, Gravity
from tci.robot.joint_calibration import JointCalibration, JointFriction, Tool

ROBOT = bare_body().robot
COUNT = len(ROBOT.servos)
ARM_SERVOS = np.array([servo.index for servo in ROBOT.servos_of(ARM)])
NONE = JointCalibration(robot=ROBOT.name)
FRICTIONLESS = JointCalibration(
    robot=ROBOT.name, friction={servo.name: JointFriction() for servo in ROBOT.servos}
)
HAND = "left_wrist_yaw_link"


def exact_motion(dynamics: Dynamics, outside: Array, seconds: float = 0.5) -> list[JointReading]:
    """Returns readings of an arm with sinusoidal motion. The torques are computed from Lagrange's equations
    with finite differences, minus the external torque `outside` (n,) [N m]."""
    amplitude = np.zeros(COUNT)
    amplitude[ARM_SERVOS] = 0.4
    phase = np.arange(COUNT)

    def motion(time: float) -> tuple[Array, Array]:
        angle = 2.0 * np.pi * 0.6 * time + phase
        return amplitude * np.sin(angle), amplitude * 2.0 * np.pi * 0.6 * np.cos(angle)

    def energy(position: Array, velocity: Array) -> float:
        return 0.5 * float(velocity @ dynamics.at(position, velocity)[0] @ velocity)

    def momentum(time: float) -> Array:
        position, velocity = motion(time)
        return dynamics.at(position, velocity)[0] @ velocity

    readings, step = [], 1e-5
    for number in range(round(seconds / PERIOD)):
        time = number * PERIOD
        position, velocity = motion(time)
        torque = (momentum(time + step) - momentum(time - step)) / (2.0 * step)
        torque += dynamics.at(position, np.zeros(COUNT))[1] - outside
        for servo in ARM_SERVOS:
            shift = np.eye(COUNT)[servo] * 1e-5
            torque[servo] -= (energy(position + shift, velocity) - energy(position - shift, velocity)) / 2e-5
        readings.append(
            JointReading(time, number, read_only(position), read_only(velocity), read_only(torque))
        )
    return readings


def test_a_moving_arm_without_errors_has_no_residual_and_a_push_is_a_first_order_filter() -> None:
    dynamics = Dynamics(ROBOT, FRICTIONLESS)
    outside = np.zeros(COUNT)
    for torque in (0.0, 2.0):
        outside[ARM_SERVOS[3]] = torque
        observer = MomentumObserver(ROBOT, FRICTIONLESS)
        found = [observer.step(joints) for joints in exact_motion(dynamics, outside)]
        assert found[0] is None
        residuals = np.array([one.torque[ARM_SERVOS] for one in found[1:] if one is not None])
        wanted = np.zeros(residuals.shape)
        wanted[:, 3] = torque * (1.0 - np.exp(-50.0 * PERIOD * np.arange(1, len(wanted) + 1)))
        # a difference quotient of the mass matrix has a delay of half a period
        np.testing.assert_allclose(residuals, wanted, atol=0.06)
        assert abs(residuals[-1, 3] - torque) < 0.04


def test_a_tool_in_hand_is_weight_that_the_observer_knows() -> None:
    position, still = np.zeros(COUNT), np.zeros(COUNT)
    position[ARM_SERVOS[3]] = 0.5
    tool = JointCalibration(robot=ROBOT.name, tools={HAND: Tool(mass=0.5, centre=(0.1, 0.0, 0.02))})
    plain, bias = Dynamics(ROBOT, NONE).at(position, still)
    loaded, held = Dynamics(ROBOT, tool).at(position, still)
    kinematics = bare_body().skin.kinematics
    lever = kinematics.jacobian(position, HAND, point=np.array(tool.tools[HAND].centre))[:3]
    np.testing.assert_allclose(
        (held - bias)[ARM_SERVOS], (0.5 * STANDARD_GRAVITY * lever[2])[ARM_SERVOS], atol=1e-9
    )
    own = np.ix_(ARM_SERVOS, ARM_SERVOS)
    np.testing.assert_allclose((loaded - plain)[own], (0.5 * lever.T @ lever)[own], atol=1e-9)
    with pytest.raises(UnknownNameError, match="link of a tool"):
        Dynamics(ROBOT, JointCalibration(robot=ROBOT.name, tools={"left_glove": Tool(mass=0.1)}))


def test_gravity_minus_the_acceleration_of_the_base_holds_the_links() -> None:
    position = np.linspace(-0.3, 0.3, COUNT)
    dynamics, still = Dynamics(ROBOT, NONE), np.zeros(COUNT)
    np.testing.assert_allclose(dynamics.at(position, still)[1], Gravity(ROBOT).torques(position), atol=1e-9)
    # the frame of the torso is parallel to that of the root
    position[[servo.index for servo in ROBOT.servos_of("torso")]] = 0.0
    leaning = np.array([3.0, 0.0, -9.0])
    wanted = Gravity(ROBOT).torques(position, down=leaning) * np.linalg.norm(leaning) / STANDARD_GRAVITY
    np.testing.assert_allclose(dynamics.at(position, still, leaning)[1], wanted, atol=1e-9)
    assert np.abs(wanted - dynamics.at(position, still)[1]).max() > 0.5


def test_the_observer_starts_anew_after_a_gap_and_is_silent_without_torques() -> None:
    readings = exact_motion(Dynamics(ROBOT, FRICTIONLESS), np.zeros(COUNT), 0.1)
    observer = MomentumObserver(ROBOT, FRICTIONLESS)
    assert [observer.step(joints) is None for joints in readings[:3]] == [True, False, False]
    late = replace(readings[3], stamp=readings[3].stamp + 1.0)
    assert observer.step(late) is None
    assert observer.step(replace(readings[4], torque=None)) is None
    assert observer.step(readings[5]) is None
    found = observer.step(readings[6])
    assert found is not None


def test_a_servo_without_torque_tells_nothing() -> None:
    readings = exact_motion(Dynamics(ROBOT, FRICTIONLESS), np.zeros(COUNT), 0.1)
    missing = ARM_SERVOS[5]
    observer = MomentumObserver(ROBOT, FRICTIONLESS)
    for joints in readings:
        assert joints.torque is not None
        torque = joints.torque.copy()
        torque[missing] = np.nan
        found = observer.step(replace(joints, torque=read_only(torque)))
    assert found is not None
    assert np.isinf(found.deviation[missing])
    assert np.isfinite(found.torque).all()
    assert np.isfinite(np.delete(found.deviation, missing)).all()


def test_unknown_friction_makes_the_observer_less_sure_than_known_friction() -> None:
    readings = exact_motion(Dynamics(ROBOT, NONE), np.zeros(COUNT), 0.02)
    deviations = []
    for calibration in (FRICTIONLESS, NONE):
        observer = MomentumObserver(ROBOT, calibration)
        found = [observer.step(joints) for joints in readings][-1]
        assert found is not None
        deviations.append(found.deviation[ARM_SERVOS])
    assert (deviations[1] > deviations[0]).all()


@pytest.mark.parametrize("wrong", [{"gain": 0.0}, {"noise": -1.0}, {"friction": np.nan}, {"masses": np.inf}])
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TciError, match="valid"):
        ObserverSettings(**wrong)


def test_a_calibration_of_another_robot_or_servo_is_refused() -> None:
    for other in (
        JointCalibration(robot="nao"),
        JointCalibration(robot=ROBOT.name, friction={"left_tail": JointFriction(coulomb=0.1)}),
    ):
        with pytest.raises(TciError, match="valid"):
            other.check(tci.load_robot("g1"))


def test_the_gain_is_lower_for_slow_readings() -> None:
    outside = np.zeros(COUNT)
    outside[ARM_SERVOS[0]] = 1.0
    readings = exact_motion(Dynamics(ROBOT, FRICTIONLESS), outside, 1.0)[::10]
    observer = MomentumObserver(ROBOT, FRICTIONLESS)
    found = [one.torque[ARM_SERVOS[0]] for one in map(observer.step, readings) if one is not None]
    assert found[-1] == pytest.approx(1.0, abs=0.1)
    assert max(found) < 1.15
    assert all(b > a - 0.05 for a, b in pairwise(found))


@pytest.mark.parametrize("field", ["position", "velocity"])
def test_a_reading_that_is_none_is_forgotten(field: str) -> None:
    observer = MomentumObserver(ROBOT, FRICTIONLESS)
    readings = exact_motion(Dynamics(ROBOT, FRICTIONLESS), np.zeros(COUNT), seconds=0.04)
    broken = np.array(getattr(readings[3], field))
    broken[ARM_SERVOS[0]] = np.nan
    readings[3] = replace(readings[3], **{field: read_only(broken)})
    found = [observer.step(joints) for joints in readings]
    assert found[3] is None
    assert found[4] is None  # the observer starts again
    last = found[-1]
    assert last is not None
    assert np.isfinite(last.torque).all()
    assert np.abs(last.torque).max() < 0.05
