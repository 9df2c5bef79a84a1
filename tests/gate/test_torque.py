"""Torque mode with a simulated plant: a torque ends when the reading from which it was computed becomes too
old."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.closed_loop import OVER, REST_IN, SLOW, SPEEDS, ClosedLoop
from helpers.gate_checks import LIMITS, make_robot
from helpers.joint_plant import Plant
from tci.gate import freshness
from tci.gate.freshness import Freshness
from tci.gate.gate import Gate, GateSettings, GateState, SafeCommand
from tci.gate.kernels import torques as torque
from tci.gate.speeds import Slope
from tci.gate.torque import CREEP, TorqueLimiter
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import read_only
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position

PERIOD = 0.002
ICUB = load_robot("icub")
ELBOW = next(servo for servo in ICUB.servos if servo.name == "l_elbow")
END = 0.05
"""Time [s] from the last new reading within which torques end."""
ROBOT = make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)


class Elbow:
    """iCub's left elbow in torque mode. With its motor it has `mass` times 0.1 kg m2; the links alone have
    0.042 at least."""

    def __init__(self, *, mass: float = 1.0) -> None:
        self.gate = Gate(ICUB, period=PERIOD, stale_after=0.05)
        start = np.array(initial_position(ICUB))
        start[ELBOW.index] = np.deg2rad(60.0)
        self.plant = Plant(ICUB, start, np.random.default_rng(0), wrong=0.0)
        self.plant.inertia[ELBOW.index] = 0.1 * mass
        self.plant.weight[:] = 0.0
        self.now, self.sequence = 0.0, 0
        self.torques: list[float] = []
        self.step(PlatformSwitch(np.array([ELBOW.index]), Mode.TORQUE))

    @property
    def angle(self) -> float:
        return float(self.plant.position[ELBOW.index])

    @property
    def speed(self) -> float:
        return float(self.plant.velocity[ELBOW.index])

    def joints(self) -> JointReading:
        self.sequence += 1
        p = self.plant
        return JointReading(
            self.now, self.sequence, read_only(p.position.copy()), read_only(p.velocity.copy())
        )

    def step(self, *orders: PlatformOrder, joints: JointReading | None = None) -> SafeCommand:
        safe = self.gate.step(orders, self.joints() if joints is None else joints, self.now)
        self.plant.obey(safe)
        self.torques.append(float(self.plant.sent[ELBOW.index]))
        self.plant.advance(PERIOD)
        self.now += PERIOD
        return safe

    def push(self, torque: float, joints: JointReading | None = None) -> SafeCommand:
        index = np.array([ELBOW.index])
        return self.step(PlatformCommand(Mode.TORQUE, index, np.array([torque]), np.ones(1)), joints=joints)

    def until_braked(self, torque: float) -> JointReading:
        """Sends torques until the gate brakes before the lower limit. Returns the last reading."""
        for _ in range(3000):
            joints = self.joints()
            self.push(torque, joints)
            if self.torques[-1] * torque < 0.0 and abs(self.torques[-1]) > 0.3:
                return joints
        raise AssertionError("the gate never braked")


@pytest.mark.parametrize("torque", [-1.5, 1.5, -30.0, 30.0])
def test_joint_data_that_freezes_while_the_gate_brakes_leaves_no_torque(torque: float) -> None:
    elbow = Elbow()
    last = elbow.until_braked(torque)
    fastest, energies = 0.0, []
    for step in range(1500):
        safe = elbow.push(torque, last)
        fastest = max(fastest, abs(elbow.speed))
        if elbow.now - PERIOD - last.stamp >= END:
            assert elbow.torques[-1] == 0.0, f"{step * PERIOD:.3f} s after the last reading"
            energies.append(float(elbow.plant.energy[ELBOW.index]))
    assert safe.state is GateState.HOLD
    assert fastest <= ELBOW.limits.velocity
    assert np.diff(energies).max() < 1e-9


def test_while_it_holds_with_fresh_data_the_gate_goes_on_braking() -> None:
    elbow = Elbow()
    elbow.until_braked(1.5)
    while abs(elbow.angle - ELBOW.limits.upper) > np.deg2rad(1.0) and abs(elbow.speed) > 0.05:
        elbow.gate.hold("calm down")
        assert elbow.push(1.5).state is GateState.HOLD
        assert elbow.angle <= ELBOW.limits.upper
    assert min(elbow.torques) < -0.2 * 1.5
    assert elbow.angle <= ELBOW.limits.upper


@pytest.mark.parametrize("how", ["same number", "same stamp", "older"])
def test_readings_that_bring_nothing_new_are_no_readings(how: str) -> None:
    """With 1.5 N m the joint moves only a little. The torque ends, and then the robot holds."""
    elbow = Elbow()
    for _ in range(50):
        last = elbow.joints()
        elbow.push(1.5, last)
    for step in range(1, 40):
        true = elbow.joints()
        joints = {
            "same number": replace(true, sequence=last.sequence),
            "same stamp": replace(true, stamp=last.stamp),
            "older": replace(true, stamp=last.stamp - 1e-3 * (step % 3)),
        }[how]
        safe = elbow.push(1.5, joints)
        if elbow.now - PERIOD - last.stamp >= END:
            assert elbow.torques[-1] == 0.0
    assert safe.state is not GateState.RUN
    if how == "same number":
        assert "frozen" in str(safe.reason) or "no new joint data for" in str(safe.reason)


def test_after_a_gap_a_torque_rises_again_in_time() -> None:
    elbow = Elbow(mass=1000.0)
    for _ in range(1000):
        last = elbow.joints()
        elbow.push(15.0, last)
    assert elbow.torques[-1] == 15.0
    for _ in range(20):
        elbow.push(15.0, last)
    assert elbow.torques[-1] == 0.0
    for _ in range(12):
        elbow.push(15.0)
    rises = np.diff(elbow.torques)[-12:]
    assert rises.max() <= 30.0 * PERIOD / torque.RISE * (1.0 + 1e-9)
    assert elbow.torques[-1] > 3.0


def test_a_joint_that_really_is_too_fast_is_braked_and_its_encoder_believed() -> None:
    """At 100 Hz, 2.8 times its limit is more than 2 degrees a period beyond it; angle and velocity agree."""
    period, speed, index = 0.01, 2.8 * ELBOW.limits.velocity, np.array([ELBOW.index])
    gate = Gate(ICUB, period=period, stale_after=0.05)
    angles, speeds = np.array(initial_position(ICUB)), np.zeros(len(ICUB.servos))
    angles[ELBOW.index] = np.deg2rad(20.0)
    for step in range(16):
        if step == 8:
            speeds[ELBOW.index] = speed
        angles += period * speeds
        orders: list[PlatformOrder] = [PlatformCommand(Mode.TORQUE, index, np.array([5.0]), np.ones(1))]
        if not step:
            orders = [PlatformSwitch(index, Mode.TORQUE)]
        joints = JointReading(step * period, step, read_only(angles.copy()), read_only(speeds.copy()))
        safe = gate.step(orders, joints, step * period)
    assert safe.state is GateState.RUN
    assert safe.torque[0] < -1.0


def test_a_stop_because_of_a_lie_ends_braking_too() -> None:
    """Otherwise a wrong encoder could drive the joint to the other end of its range."""
    elbow = Elbow()
    last = elbow.until_braked(-1.5)
    for _ in range(400):
        true = elbow.joints()
        safe = elbow.push(-1.5, replace(true, position=last.position, velocity=last.velocity))
        if safe.state is GateState.STOP:
            break
    assert "l_elbow is" in str(safe.reason)
    assert "from where its velocity leads" in str(safe.reason)
    for _ in range(25):
        true = elbow.joints()
        elbow.push(-1.5, replace(true, position=last.position, velocity=last.velocity))
    assert elbow.torques[-1] == 0.0


@pytest.mark.parametrize("torque", [-1.5, 1.5, -20.0, 20.0])
def test_a_velocity_that_stays_at_zero_does_not_let_a_joint_run_away(torque: float) -> None:
    """In torque mode only the measured velocity lets the gate brake the joint."""
    elbow = Elbow()
    fastest = 0.0
    for _ in range(1500):
        true = elbow.joints()
        safe = elbow.push(torque, replace(true, velocity=read_only(np.zeros(len(ICUB.servos)))))
        fastest = max(fastest, abs(elbow.speed))
    assert safe.state is GateState.STOP
    assert "the angle of l_elbow is" in str(safe.reason)
    assert "from where its velocity leads" in str(safe.reason)
    assert elbow.torques[-1] == 0.0
    assert fastest <= (1.0 + OVER) * ELBOW.limits.velocity


@pytest.mark.parametrize("mass", [0.35, 1.0, 3.0])
def test_a_joint_is_braked_without_being_thrown_about(mass: float) -> None:
    """With full torque the motion of this joint would reverse in each period."""
    elbow = Elbow(mass=mass)
    for _ in range(40):
        elbow.push(0.3)
    elbow.gate.stop("the operator says so")
    begin = len(elbow.torques)
    for _ in range(100):
        elbow.push(0.3)
    assert abs(elbow.speed) < 1e-3
    late = elbow.torques[begin + 50 :]
    assert np.abs(late).max() < 0.01 * ELBOW.limits.torque


def test_a_stop_for_another_reason_still_sees_a_lie_that_comes_later() -> None:
    elbow = Elbow()
    last = elbow.until_braked(1.5)
    elbow.gate.stop("the operator says so")
    for _ in range(300):
        true = elbow.joints()
        safe = elbow.push(1.5, replace(true, position=last.position, velocity=last.velocity))
    assert str(safe.reason) == "the operator says so"
    assert elbow.torques[-1] == 0.0


def test_a_reset_does_not_let_a_servo_start_where_frozen_data_says() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    frozen = JointReading(0.0, 7, read_only(np.zeros(6)), read_only(np.zeros(6)))
    for step in range(60):
        gate.step([], replace(frozen, stamp=step * PERIOD), step * PERIOD)
    assert gate.state is GateState.STOP
    gate.reset()
    now = 60 * PERIOD
    order = PlatformCommand(Mode.POSITION, np.array([2]), np.array([0.3]), np.ones(1))
    safe = gate.step([order], replace(frozen, stamp=now), now)
    assert [*map(str, safe.refusals)] == ["hold: no new joint data for 120 ms"]
    assert safe.servos.size == 0
    safe = gate.step([order], replace(frozen, stamp=now + PERIOD, sequence=8), now + PERIOD)
    assert safe.refusals == ()
    assert safe.servos.tolist() == [2]


def test_a_reset_does_not_let_a_reading_that_was_not_believed_count_as_new_later() -> None:
    """The reading arrived while the data were not trusted, and was repeated with new time stamps since
    then."""
    elbow = Elbow()
    last = elbow.until_braked(30.0)
    jumped = replace(elbow.joints(), position=read_only(last.position - np.deg2rad(20.0)))
    for _ in range(60):
        safe = elbow.push(30.0, replace(jumped, stamp=elbow.now))
    assert "jumped by 20.0 degrees" in str(safe.reason)
    elbow.gate.reset()
    begin = len(elbow.torques)
    for _ in range(20):
        safe = elbow.push(30.0, replace(jumped, stamp=elbow.now))
        assert safe.state is GateState.HOLD
        assert "no new joint data for" in str(safe.reason)
    assert not np.any(elbow.torques[begin:])


def test_ordinary_positions_hold_at_the_same_age_as_ever() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    joints = JointReading(1.0, 7, read_only(np.zeros(6)), read_only(np.zeros(6)))
    for age, state in ((0.0, GateState.RUN), (0.0499, GateState.RUN), (0.0501, GateState.HOLD)):
        assert gate.step([], joints, 1.0 + age).state is state
        assert gate.step([], joints, 1.0 + age).state is state


def test_the_age_of_repeated_data_is_told_in_milliseconds() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05, settings=GateSettings(monitor=None))
    joints = JointReading(0.0, 7, read_only(np.zeros(6)), read_only(np.zeros(6)))
    gate.step([], joints, 0.0)
    safe = gate.step([], replace(joints, stamp=2.0), 2.0)
    assert safe.reason == Reason(Code.JOINTS_STALE, "no new joint data for 2000 ms")


def reading(stamp: float, sequence: int) -> JointReading:
    return JointReading(stamp, sequence, read_only(np.zeros(1)), read_only(np.zeros(1)))


def test_data_is_as_old_as_its_stamp_or_as_its_arrival_if_that_was_before() -> None:
    fresh = Freshness(PERIOD)
    assert fresh.age(0.0) == math.inf
    assert fresh.see(reading(1.0, 1), 1.01)
    assert fresh.age(1.01) == pytest.approx(0.01)
    assert not fresh.see(reading(1.5, 1), 1.02), "the number came before"
    assert not fresh.see(reading(1.0, 2), 1.02), "the stamp came before"
    assert not fresh.see(reading(0.9, 2), 1.02)
    assert fresh.age(1.03) == pytest.approx(0.03)
    assert fresh.see(reading(1.04, 2), 1.03), "a clock that is a little ahead"
    assert fresh.age(1.05) == pytest.approx(0.02)


@pytest.mark.parametrize("now", [math.nan, math.inf, -math.inf])
def test_at_a_time_that_is_none_data_has_no_age(now: float) -> None:
    fresh = Freshness(PERIOD)
    fresh.see(reading(1.0, 1), 1.0)
    assert fresh.age(now) == math.inf
    assert fresh.trust(fresh.age(now)) == 0.0


def test_where_time_goes_back_data_is_old_until_new_comes() -> None:
    fresh = Freshness(PERIOD)
    fresh.see(reading(1.0, 1), 1.0)
    assert fresh.age(1.0 - 0.9 * PERIOD) == 0.0
    assert fresh.age(1.0 - 1.1 * PERIOD) == math.inf
    assert not fresh.see(reading(0.5, 1), 0.5)
    assert fresh.see(reading(0.502, 2), 0.502)
    assert fresh.age(0.503) == pytest.approx(1e-3)


@pytest.mark.parametrize(("interval", "delay"), [(0.002, 0.0), (0.01, 0.0), (0.002, 0.008), (0.01, 0.003)])
def test_data_counts_in_full_up_to_the_age_that_it_usually_has_and_never_for_long(
    interval: float, delay: float
) -> None:
    fresh = Freshness(PERIOD)
    for number in range(1, 200):
        fresh.see(reading(number * interval, number), number * interval + delay)
    usual = interval + delay
    counts = min(PERIOD + usual, freshness.LONGEST)
    assert fresh.trust(usual) == 1.0
    assert fresh.trust(counts - 1e-6) == 1.0
    assert fresh.trust(counts + 1e-4) == pytest.approx(1.0 - 1e-4 / freshness.FADE, abs=1e-6)
    assert fresh.trust(counts + 0.5 * freshness.FADE) == pytest.approx(0.5, abs=1e-4)
    assert fresh.trust(counts + freshness.FADE + 1e-6) == 0.0
    assert freshness.LONGEST + freshness.FADE <= END


def test_data_is_overdue_a_period_after_the_age_that_it_had_at_most() -> None:
    fresh = Freshness(PERIOD)
    for number in range(1, 60):
        late = 0.03 if number == 50 else 0.0
        fresh.see(reading(number * 0.01, number), number * 0.01 + 0.005 + late)
        if number < 20:
            assert not fresh.overdue(1.0), "nothing is known yet"
    fresh.see(reading(9.0, 60), 9.0)  # a silence of 8 s
    longest = 0.01 + 0.005 + 0.03
    assert not fresh.overdue(longest - 0.01)
    assert fresh.overdue(longest + PERIOD + 1e-6)
    for number in range(61, 1100):
        fresh.see(reading(9.0 + number * 0.01, number), 9.0 + number * 0.01 + 0.005)
    assert fresh.overdue(0.015 + 1.5 * PERIOD), "what was late once is forgotten after some seconds"


def test_a_long_silence_is_no_habit() -> None:
    fresh, twin = Freshness(PERIOD), Freshness(PERIOD)
    for number in range(1, 100):
        for one in (fresh, twin):
            one.see(reading(number * PERIOD, number), number * PERIOD)
    fresh.see(reading(100.0, 100), 100.0)
    twin.see(reading(100 * PERIOD + freshness.LONGEST, 100), 99 * PERIOD + freshness.LONGEST)
    for age in np.arange(0.0, 0.05, 1e-4):
        assert fresh.trust(age) == pytest.approx(twin.trust(age), abs=1e-6)


def limiter() -> TorqueLimiter:
    """Returns a limiter for servo 2 of the made robot, with limits of 5 N m, 40 rad/s2 and 2.7 rad/s."""
    made = TorqueLimiter(ROBOT, PERIOD, speed_share=0.9, push=0.1)
    made.set_servos([2])
    return made


def test_another_servo_in_torque_mode_changes_no_torque_and_starts_at_zero_itself() -> None:
    made = limiter()
    made.ask(np.array([2]), np.array([2.0]))
    for _ in range(20):
        made.step(*states(0.5, 0.0))
    made.set_servos([2, 3])
    assert made.step(*states(0.5, 0.0)).tolist() == [2.0, 0.0]
    made.set_servos([3])
    made.set_servos([2, 3])
    assert made.step(*states(0.5, 0.0)).tolist() == [0.0, 0.0], "a servo that comes back starts anew"


def states(angle: float, speed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns angles, velocities, and mean speeds that are computed from the angles."""
    position, velocity = np.zeros(6), np.zeros(6)
    position[2], velocity[2] = angle, speed
    return position, velocity, velocity


def test_a_torque_is_the_share_of_itself_that_its_data_is_trusted() -> None:
    made = limiter()
    made.ask(np.array([2]), np.array([2.0]))
    for _ in range(20):
        full = made.step(*states(0.5, 0.0))
    assert full.tolist() == [2.0]
    assert made.step(*states(0.5, 0.0), trust=0.5).tolist() == [1.0]
    assert made.step(*states(0.5, 0.0), trust=0.0).tolist() == [0.0]
    assert made.step(*states(0.5, 0.0)).tolist() == [5.0 * PERIOD / torque.RISE]
    assert made.step(*states(0.5, 8.0)).tolist() == [-5.0]
    assert made.step(*states(0.5, 8.0), drives=False).tolist() == [-5.0]
    assert made.step(*states(0.5, 8.0), trust=0.25).tolist() == [-1.25]


def test_without_new_data_no_torque_drives() -> None:
    made = limiter()
    made.ask(np.array([2]), np.array([2.0]))
    for _ in range(20):
        made.step(*states(0.5, 0.0))
    assert made.step(*states(0.5, 0.0), drives=False).tolist() == [0.0]
    assert made.step(*states(0.5, 0.0)).tolist() == [2.0]


def test_older_data_brakes_earlier_and_more_gently() -> None:
    """The limiter uses the position that the joint will have when the torque takes effect."""
    near = LIMITS.upper - 0.12
    assert limiter().step(*states(near, 1.5)).tolist() == [0.0]
    assert limiter().step(*states(near, 1.5), age=0.03)[0] < -1.0
    quick, late = limiter().step(*states(2.0, 0.1)), limiter().step(*states(2.0, 0.1), age=PERIOD)
    assert quick[0] < late[0] < 0.0


@pytest.mark.parametrize("often", [1, 2, 10])
def test_a_gate_that_is_stepped_too_often_raises_no_torque_faster(often: int) -> None:
    elbow = Elbow(mass=100.0)
    index, now, rise = np.array([ELBOW.index]), elbow.now, 30.0 * PERIOD / torque.RISE
    for step in range(8 * often):
        joints = replace(elbow.joints(), stamp=now + step * PERIOD / often)
        order = PlatformCommand(Mode.TORQUE, index, np.array([4.0]), np.ones(1))
        sent = float(elbow.gate.step(order, joints, joints.stamp).torque[0])
        assert sent <= rise * (step // often + 1) + 1e-9, f"after {step / often:.1f} periods"
    assert sent == 4.0
    assert elbow.gate.step([], joints, math.nan).torque.tolist() == [0.0]


def test_between_two_steps_torques_stay_and_end_with_the_trust_in_their_data() -> None:
    made = limiter()
    assert made.again(trust=1.0).tolist() == [0.0]
    made.ask(np.array([2]), np.array([2.0]))
    for _ in range(20):
        made.step(*states(0.5, 0.0))
    for trust, left in ((1.0, 2.0), (0.5, 1.0), (0.8, 1.0), (0.0, 0.0), (1.0, 0.0)):
        assert made.again(trust=trust).tolist() == [left]
    assert made.step(*states(0.5, 0.0)).tolist() == [5.0 * PERIOD / torque.RISE]
    made.step(*states(0.5, 4.0))
    assert made.again(trust=0.5).tolist() == [-2.5]
    made.set_servos([])
    made.set_servos([2])
    assert made.again(trust=1.0).tolist() == [0.0]


@pytest.mark.parametrize(("slope", "braked"), [(1.0, True), (0.3, True), (0.0, False), (-0.3, True),
                                               (-0.6, False), (-1.0, False), (np.nan, True)])  # fmt: skip
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_whose_angle_contradicts_its_velocity_is_not_braked(
    slope: float, braked: bool, way: float
) -> None:
    """With a velocity that is constant or has the wrong sign, braking would accelerate the joint."""
    made = limiter()
    position, velocity, told = states(0.5, way * 1.0)
    made.halt()
    sent = float(made.step(position, velocity, told * slope)[0])
    assert sent == (-way * 5.0 if braked else 0.0)


def test_the_faster_of_velocity_and_angle_limits_a_torque() -> None:
    for speed, slope, driven in ((0.0, 2.8, False), (2.0, 2.8, False), (0.0, 2.0, True), (0.0, -9.0, True)):
        made = limiter()
        made.ask(np.array([2]), np.array([0.5]))
        position, velocity, _ = states(0.5, speed)
        told = states(0.5, slope)[1]
        assert (float(made.step(position, velocity, told)[0]) > 0.0) == driven


def test_angles_tell_a_mean_speed_over_readings_that_are_near_enough() -> None:
    slope = Slope(1)
    assert np.isnan(slope.speed).all()
    assert slope.span == 0.0

    def see(stamp: float, angle: float) -> tuple[float, float]:
        slope.step(JointReading(stamp, 0, read_only([angle]), read_only([0.0])))
        return float(slope.speed[0]), slope.span

    assert np.isnan(see(1.0, 0.5)[0])
    assert see(1.01, 0.6) == pytest.approx((10.0, 0.01))
    assert see(1.0199, 0.5) == pytest.approx((0.0, 0.0199))
    assert see(1.025, 0.75) == pytest.approx((10.0, 0.015))
    assert np.isnan(see(1.05, 0.8)[0]), "they come too seldom"
    assert see(1.05 + 0.01, 0.7) == pytest.approx((-10.0, 0.01))
    assert np.isnan(see(0.5, 0.7)[0]), "time went back"


def test_22_a_servo_that_is_off_gets_no_torque_and_does_not_jump_when_it_is_on_again() -> None:
    elbow = Elbow()
    elbow.until_braked(30.0)
    off = np.ones(len(ICUB.servos), dtype=bool)
    off[ELBOW.index] = False
    for _ in range(5):
        safe = elbow.push(30.0, replace(elbow.joints(), powered=off))
        assert safe.state is GateState.STOP
        assert elbow.torques[-1] == 0.0
    for _ in range(5):
        elbow.push(30.0, replace(elbow.joints(), powered=~off | off))
    assert elbow.torques[-1] * elbow.speed <= 0.0, "it brakes"


def test_a_robot_that_comes_back_after_a_lie_is_not_believed_before_an_operator_looked() -> None:
    elbow = Elbow()
    last = elbow.until_braked(1.5)
    jumped = replace(elbow.joints(), position=read_only(last.position - np.deg2rad(20.0)))
    assert "jumped" in str(elbow.push(1.5, jumped).reason)
    elbow.gate.drop()
    for _ in range(30):
        elbow.push(1.5)
    assert elbow.torques[-10:] == [0.0] * 10
    elbow.gate.reset()
    for _ in range(10):
        safe = elbow.push(-1.5)
    assert safe.state is GateState.RUN
    assert elbow.torques[-1] != 0.0


@pytest.mark.parametrize("stamp", [-1.0, 1.0, math.nan])
def test_a_reading_that_could_not_be_used_is_not_new_under_a_fresh_stamp(stamp: float) -> None:
    elbow = Elbow(mass=100.0)
    for _ in range(30):
        elbow.push(15.0)
    spoilt = elbow.joints()
    for _ in range(40):
        elbow.push(15.0, replace(spoilt, stamp=elbow.now + stamp))
    assert elbow.torques[-1] == 0.0
    for _ in range(20):
        elbow.push(15.0, replace(spoilt, stamp=elbow.now))
        assert elbow.torques[-1] == 0.0


@pytest.mark.parametrize("angle", [2.0 + 1e-3, -1.0 - 1e-3])
def test_24_from_outside_a_torque_leads_inward_slowly(angle: float) -> None:
    inward = -np.sign(angle)
    slow = CREEP * 0.9 * LIMITS.velocity
    for share, braked in ((0.85, False), (1.05, True)):
        made = limiter()
        made.ask(np.array([2]), np.array([inward * 0.5]))
        sent = float(made.step(*states(angle, inward * share * slow))[0])
        assert (sent * inward < 0.0) == braked
        assert braked or sent == inward * 0.5
    assert limiter().step(*states(angle + inward * 0.1, inward * 1.05 * slow)).tolist() == [0.0]


@pytest.mark.parametrize("fault", SPEEDS)
@pytest.mark.parametrize("seed", range(2))
def test_a_wrong_velocity_lets_no_joint_pass_its_limit_of_speed(fault: str, seed: int) -> None:
    loop = ClosedLoop(ROBOT, seed, Mode.TORQUE)
    loop.begin(fault, lasts=1.0)
    for _ in range(500):
        loop.step()
    assert loop.true.faults == []


@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_whatever_moves_rests_in_time_when_the_gate_holds(mode: Mode) -> None:
    loop = ClosedLoop(ROBOT, 6, mode)
    loop.begin("none", lasts=1.0)
    fastest = 0.0
    for _ in range(500):
        loop.step()
        fastest = max(fastest, np.abs(loop.plant.velocity).max())
    loop.begin("calm", lasts=2.0)
    for _ in range(900):
        loop.step()
        if loop.now > loop._since + REST_IN:
            assert np.abs(loop.plant.velocity).max() < SLOW
    assert fastest > 0.1
    assert loop.true.faults == []


@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_the_true_motion_stays_in_bounds_whatever_is_asked_for_and_read(mode: Mode) -> None:
    loop = ClosedLoop(ROBOT, 4, mode)
    for _ in range(4000):
        loop.step()
    assert loop.true.faults == []
    assert loop.counts.malformed > loop.counts.passed == 0
    assert len(loop.tried) >= 2
