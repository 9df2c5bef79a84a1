"""The joint monitor reports every fault within its time limit, and reports no fault of a robot that follows
its reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.gate_checks import make_robot
from tci.errors import TciError
from tci.gate.joint_monitor import JointMonitor, MonitorSettings, Reference
from tci.messages import JointReading, Mode
from tci.messages.frames import Array, read_only
from tci.reasons import Code, Reason

ROBOT = make_robot(count=6)
PERIOD = 0.01
SERVOS = np.arange(5)
AT_REST = np.zeros(6)
Positions = Callable[[float], Array]


def still(_: float) -> Array:
    return AT_REST


def turning(time: float) -> Array:
    """Returns reference angles (6,) [rad] at `time` [s]. All servos move back and forth at up to 1 rad/s."""
    return np.full(6, 0.5 * np.sin(2.0 * time))


def readings(measured: Positions, *, duration: float = 2.0) -> Iterator[JointReading]:
    for index in range(round(duration / PERIOD)):
        time = index * PERIOD
        velocity = (measured(time + 1e-6) - measured(time - 1e-6)) / 2e-6
        yield JointReading(time, index, read_only(measured(time)), read_only(velocity))


def reference(told: Positions, time: float, mode: Mode = Mode.POSITION) -> Reference:
    velocity = (told(time + 1e-6) - told(time - 1e-6)) / 2e-6
    return Reference(SERVOS, (mode,) * 5, told(time)[:5], velocity[:5], np.zeros(5))


def first_fault(
    measured: Positions, told: Positions, *, mode: Mode = Mode.POSITION
) -> tuple[float, Reason] | None:
    monitor = JointMonitor(ROBOT)
    for joints in readings(measured):
        if fault := monitor.step(joints, reference(told, joints.stamp, mode)):
            return joints.stamp, fault
    return None


def one_servo(change: Callable[[float, float], float], *, servo: int = 2) -> Positions:
    """Returns measured angles by time. All servos follow `turning` with a delay of 30 ms, and `change` alters
    the angles of one servo."""

    def measured(time: float) -> Array:
        position = turning(time - 0.03).copy()
        position[servo] = change(time, position[servo])
        return position

    return measured


def test_a_robot_that_obeys_late_is_fine() -> None:
    assert first_fault(one_servo(lambda _, angle: angle), turning) is None


def test_a_servo_that_bends_a_little_is_fine() -> None:
    assert first_fault(one_servo(lambda _, angle: angle + np.deg2rad(5.0)), turning) is None


def test_21_a_stalled_servo_is_told_within_its_patience() -> None:
    def stalled(time: float, angle: float) -> float:
        return angle if time < 0.3 else 0.26 + 1e-5 * np.sin(100 * time)

    found = first_fault(one_servo(stalled), turning)
    assert found is not None
    assert found[1].code is Code.FOLLOWING_ERROR
    assert "joint2 does not follow" in found[1].text
    assert found[1].text.endswith("from its reference; held or pushed, blocked, stalled or limp")
    assert 0.3 < found[0] < 1.0


@pytest.mark.parametrize("mode", [Mode.IMPEDANCE, Mode.TORQUE])
def test_a_compliant_joint_may_yield(mode: Mode) -> None:
    assert first_fault(one_servo(lambda time, angle: angle + 0.5 * np.sin(time)), turning, mode=mode) is None


def test_a_short_deviation_is_fine() -> None:
    def pushed(time: float, angle: float) -> float:
        return angle - 0.2 * np.exp(-(((time - 0.5) / 0.06) ** 2))

    assert first_fault(one_servo(pushed), turning) is None


def test_19_a_motion_against_its_command_is_told_after_a_tenth_of_a_second() -> None:
    def reversed_(time: float, angle: float) -> float:
        return -0.5 * np.sin(2.0 * time)

    settings = MonitorSettings(following_error=3.0)
    monitor = JointMonitor(ROBOT, settings)
    for joints in readings(one_servo(reversed_)):
        if fault := monitor.step(joints, reference(turning, joints.stamp)):
            break
    assert fault is not None
    assert fault.code is Code.OPPOSED_MOTION
    assert (
        "joint2 moves against its command; pushed or pulled; if nothing touches it, the sign of its gamma"
        in fault.text
    )
    assert settings.opposing < joints.stamp < settings.opposing + 3 * PERIOD


def back_and_forth(time: float) -> Array:
    """Reference angles (6,) [rad] that turn at 0.5 s, at 0.3 rad/s."""
    return np.full(6, 0.3 * (0.5 - abs(time - 0.5)))


def fault_of_turn(turns_after: float, lag: float) -> tuple[float, Reason] | None:
    """First fault of joints that go on for some time [s] after its reference turned, of which it is known
    by how much they lag [s]."""
    monitor = JointMonitor(ROBOT, MonitorSettings(following_error=3.0))
    for joints in readings(lambda time: back_and_forth(time - turns_after), duration=1.0):
        if fault := monitor.step(joints, reference(back_and_forth, joints.stamp), lags=np.full(6, lag)):
            return joints.stamp, fault
    return None


def test_a_joint_that_lags_turns_as_much_later_than_its_reference() -> None:
    assert fault_of_turn(0.17, 0.1) is None


@pytest.mark.parametrize("lag", [0.02, 0.1])
def test_19_a_joint_that_never_turns_is_told_a_tenth_of_a_second_after_its_lag(lag: float) -> None:
    found = fault_of_turn(2.0, lag)
    assert found is not None
    assert found[1].code is Code.OPPOSED_MOTION
    assert 0.1 < found[0] - (0.5 + lag) < 0.1 + 4 * PERIOD


def test_25_an_encoder_step_is_told_at_once() -> None:
    def stepped(time: float, angle: float) -> float:
        return angle + (np.deg2rad(10.0) if time > 0.495 else 0.0)

    found = first_fault(one_servo(stepped), turning)
    assert found is not None
    assert found[0] == pytest.approx(0.5)
    assert "the angle of joint2 jumped by" in found[1].text
    assert "possible: 3.7" in found[1].text


def test_25_counts_for_a_servo_that_nobody_commands() -> None:
    def stepped(time: float, angle: float) -> float:
        return angle + (np.deg2rad(10.0) if time > 0.495 else 0.0)

    found = first_fault(one_servo(stepped, servo=5), turning)
    assert found is not None
    assert "joint5 jumped" in found[1].text


@pytest.mark.parametrize(("speed", "jumps"), [(320.0, False), (200.0, True), (-320.0, True)])
def test_a_struck_joint_goes_as_fast_as_one_of_its_speeds_says(speed: float, jumps: bool) -> None:
    """9.2 degrees in 30 ms, from 13 to 321 degrees/s, measured on a plant: the mean of both speeds says 5."""
    monitor = JointMonitor(ROBOT)
    first, second = list(readings(still))[:2]
    before = replace(first, velocity=read_only(np.deg2rad(np.full(6, 13.0))))
    struck = replace(
        second,
        stamp=first.stamp + 0.03,
        position=read_only(first.position + np.deg2rad([0.0, 0.0, 0.0, 0.0, 0.0, 9.2])),
        velocity=read_only(np.deg2rad([13.0, 13.0, 13.0, 13.0, 13.0, speed])),
    )
    none = Reference(SERVOS[:0], (), *np.zeros((3, 0)))
    assert monitor.step(before, none) is None
    found = monitor.step(struck, none)
    assert (found is not None and found.code is Code.ENCODER_JUMPED) is jumps


@pytest.mark.parametrize(("back", "jumps"), [(0.0, False), (-20.0, True)])
@pytest.mark.parametrize("commanded", [False, True])
def test_a_joint_that_somebody_bent_springs_back_as_fast_as_it_likes(
    back: float, jumps: bool, commanded: bool
) -> None:
    """A finger that a hand bent by 14 degrees was back within 40 ms, on a plant. An encoder that jumps goes
    elsewhere; and one under command is never bent so far."""
    monitor, servos = JointMonitor(ROBOT), SERVOS if commanded else SERVOS[:0]
    k, period, found = len(servos), 0.04, []
    for index, angle in enumerate(np.deg2rad([0.0, 2.0, 5.0, 9.0, 14.0, 14.0, back])):
        joints = JointReading(period * index, index, np.full(6, angle), np.zeros(6))
        told = Reference(servos, (Mode.POSITION,) * k, np.full(k, angle), *np.zeros((2, k)))
        found.append(monitor.step(joints, told))
    assert not any(found[:-1])
    assert (found[-1] is not None and found[-1].code is Code.ENCODER_JUMPED) is (jumps or commanded)


@pytest.mark.parametrize("gap", [0.03, 0.06, 0.1])
def test_a_velocity_that_is_derived_from_the_encoder_does_not_explain_its_jump(gap: float) -> None:
    """Far beyond what a blow does: by 90 and 170 degrees, with velocities over the gap or the last 5 ms."""
    first, second = list(readings(still))[:2]
    none = Reference(SERVOS[:0], (), *np.zeros((3, 0)))
    for jump in np.deg2rad([90.0, -170.0]):
        for over in (gap, 0.005):
            monitor, own = JointMonitor(ROBOT), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            assert monitor.step(replace(first, velocity=read_only(0.0 * own)), none) is None
            jumped = replace(
                second, stamp=first.stamp + gap, position=read_only(first.position + jump * own),
                velocity=read_only(jump / over * own),
            )  # fmt: skip
            found = monitor.step(jumped, none)
            assert found is not None
            assert found.code is Code.ENCODER_JUMPED


def test_20_an_encoder_that_stands_still_is_told() -> None:
    def frozen(time: float, angle: float) -> float:
        return angle if time < 0.1 else 0.5 * np.sin(0.14)

    found = first_fault(one_servo(frozen), turning)
    assert found is not None
    assert "the encoder of joint2 stands still while its reference moved by" in found[1].text
    assert found[0] < 0.35


def test_a_joint_at_rest_may_repeat_its_angle_wherever_it_is() -> None:
    assert first_fault(still, still) is None
    assert first_fault(lambda _: np.full(6, 1.1), lambda _: np.full(6, 1.1)) is None


def test_14_a_reading_that_comes_again_under_fresh_stamps_is_told() -> None:
    monitor, told = JointMonitor(ROBOT), []
    for joints in readings(turning, duration=0.5):
        frozen = replace(joints, sequence=min(joints.sequence, 20))
        told.append(monitor.step(frozen, reference(turning, joints.stamp)))
    first = next(i for i, fault in enumerate(told) if fault)
    assert first * PERIOD == pytest.approx(0.2 + 0.1 + PERIOD)
    assert "reading 20 comes again under fresh stamps" in str(told[first])
    assert {fault.code for fault in told[first:]} == {Code.JOINTS_REPEATED}
    assert monitor.misled


def test_14_is_told_in_time_though_the_first_stamp_came_twice() -> None:
    monitor, first = JointMonitor(ROBOT), next(readings(still))
    told = [monitor.step(first, reference(still, 0.0)) for _ in range(2)]
    for index in range(1, 13):
        told.append(monitor.step(replace(first, stamp=index * PERIOD), reference(still, 0.0)))
    assert [bool(fault) for fault in told] == [False] * 12 + [True] * 2


def test_23_a_mode_that_comes_right_again_in_time_is_no_fault() -> None:
    monitor = JointMonitor(ROBOT)
    for joints in readings(still, duration=1.6):
        wrong = joints.stamp % 0.4 > 0.05
        modes = (Mode.TORQUE if wrong else Mode.POSITION,) * 6
        assert monitor.step(replace(joints, modes=modes), reference(still, joints.stamp)) is None


def test_23_a_mode_that_goes_wrong_later_is_told() -> None:
    monitor = JointMonitor(ROBOT)
    told = []
    for joints in readings(still, duration=1.0):
        modes = (Mode.TORQUE if joints.stamp > 0.1 else Mode.POSITION,) * 6
        told.append(monitor.step(replace(joints, modes=modes), reference(still, joints.stamp)))
    assert [fault is not None for fault in told] == [PERIOD * index > 0.615 for index in range(len(told))]


def test_a_servo_without_a_limit_of_speed_may_be_as_fast_as_it_likes() -> None:
    limits = ROBOT.servos[0].limits.model_copy(update={"velocity": None})
    monitor = JointMonitor(make_robot(limits=limits))
    far = replace(next(readings(still)), stamp=PERIOD, sequence=1, position=read_only(np.ones(6)))
    for joints in (next(readings(still)), far):
        assert monitor.step(joints, Reference(SERVOS[:0], (), *np.zeros((3, 0)))) is None


def test_22_a_servo_that_is_off_is_told_at_once() -> None:
    powered = np.ones(6, dtype=bool)
    powered[[3, 5]] = False
    monitor = JointMonitor(ROBOT)
    fault: Reason | None = None
    for joints in readings(still, duration=0.1):
        on = replace(joints, powered=powered if joints.stamp >= 0.05 else np.ones(6, dtype=bool))
        fault = monitor.step(on, reference(still, joints.stamp))
        assert bool(fault) == (joints.stamp >= 0.05)
    assert fault == Reason(Code.SERVO_OFF, "joint3 is under command and its servo is off")


def test_a_servo_that_is_off_and_not_under_command_is_fine() -> None:
    powered = np.ones(6, dtype=bool)
    powered[5] = False
    joints = replace(next(readings(still)), powered=powered)
    assert JointMonitor(ROBOT).step(joints, reference(still, 0.0)) is None


@pytest.mark.parametrize(
    ("change", "code", "misled"),
    [
        (lambda time, angle: angle + (0.2 if time > 0.495 else 0.0), Code.ENCODER_JUMPED, True),
        (lambda time, angle: angle if time < 0.1 else 0.5 * np.sin(0.14), Code.ENCODER_FROZEN, True),
        (lambda time, angle: angle if time < 0.3 else 0.26 + 1e-5 * np.sin(100.0 * time),
         Code.FOLLOWING_ERROR, False),
    ],
)  # fmt: skip
def test_angles_of_a_faulty_encoder_are_trusted_again_only_after_a_reset(
    change: Callable[[float, float], float], code: Code, misled: bool
) -> None:
    monitor = JointMonitor(ROBOT)
    fault = next(
        fault
        for joints in readings(one_servo(change))
        if (fault := monitor.step(joints, reference(turning, joints.stamp)))
    )
    assert (fault.code, monitor.misled) == (code, misled)
    monitor.forget()
    assert monitor.misled is misled
    monitor.reset()
    assert monitor.misled is False


def test_an_angle_that_stays_while_its_velocity_does_not_is_told() -> None:
    monitor = JointMonitor(ROBOT)
    moves = read_only(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0]))
    fault = next(
        fault
        for joints in readings(still)
        if (fault := monitor.step(
            replace(joints, velocity=moves), reference(still, joints.stamp, Mode.IMPEDANCE)
        ))
    )  # fmt: skip
    assert fault.code is Code.ENCODER_DISAGREES
    assert fault.text.startswith("the angle of joint2 is ")
    assert fault.text.endswith(" degrees from where its velocity leads")
    assert monitor.misled


@pytest.mark.parametrize(("reported", "late"), [(Mode.TORQUE, True), (Mode.POSITION, False), (None, False)])
def test_23_another_mode_than_the_commanded_one_is_told_after_a_while(
    reported: Mode | None, late: bool
) -> None:
    monitor = JointMonitor(ROBOT)
    # A driver may pass one object again while nothing changes.
    modes, commanded = (Mode.POSITION, reported, *[Mode.POSITION] * 4), (Mode.POSITION,) * 5
    for joints in readings(still, duration=1.0):
        told = reference(still, joints.stamp)._replace(modes=commanded)
        fault = monitor.step(replace(joints, modes=modes), told)
        assert bool(fault) == (late and joints.stamp > monitor.settings.mode_change)
    expected = Reason(Code.SERVO_MODE, "joint1 reports mode torque; commanded in position")
    assert fault == (expected if late else None)


def test_the_same_reading_twice_tells_nothing_new() -> None:
    monitor = JointMonitor(ROBOT)
    for joints in readings(one_servo(lambda _, angle: angle)):
        for _ in range(3):
            assert monitor.step(joints, reference(turning, joints.stamp)) is None


def test_reset_forgets() -> None:
    monitor = JointMonitor(ROBOT)
    first, second = list(readings(still))[:2]
    jumped = replace(second, position=read_only(np.ones(6)))
    assert monitor.step(first, reference(still, 0.0)) is None
    monitor.reset()
    assert monitor.step(jumped, Reference(SERVOS[:0], (), *np.zeros((3, 0)))) is None


@given(lag=st.floats(0.0, 0.08), noise=st.floats(0.0, 2e-3), seed=st.integers(0, 1000))
def test_no_false_alarm_for_any_lag_and_noise_of_a_sound_servo(lag: float, noise: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    monitor = JointMonitor(ROBOT)
    for joints in readings(lambda time: turning(time - lag), duration=1.0):
        noisy = replace(joints, position=joints.position + noise * rng.standard_normal(6))
        assert monitor.step(noisy, reference(turning, joints.stamp)) is None


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_settings_that_make_no_sense_are_refused(value: float) -> None:
    with pytest.raises(TciError, match=r"monitor: patience .*; valid: above 0 and finite"):
        MonitorSettings(patience=value)
