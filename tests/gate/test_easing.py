"""A person who is pressed while an encoder is wrong bears no more than what holds the arm's weight."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from helpers import squeezed
from helpers.gate_checks import position_command, reading
from helpers.rigid_robot import RigidRobot
from helpers.squeezed import Squeeze, squeeze
from tci.gate.contact.easing import Easing
from tci.gate.contact.felt import Felt
from tci.gate.contact.group import Group, make_groups
from tci.gate.contact.noticing import Seen
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.weights import Sags
from tci.gate.gate import Gate, GateSettings, GateState
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.messages import Contacts, Mode, PlatformCommand, Reading
from tci.messages.contacts import CONTACT, TAXEL, Site
from tci.messages.frames import Array, read_only
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.robot.gravity import Gravity
from tci.robot.joint_map import initial_position

ANSWERS = GateSettings(contact=ContactSettings())
ROBOT = load_robot("icub")
PLACE = {servo.name: servo.index for servo in ROBOT.servos}
ROLL = PLACE["l_shoulder_roll"]
PERIOD = 0.01
FELT_AFTER = 0.03
"""Time [s] after a contact at which an encoder of the arm jumps."""
TRIAL = Squeeze(
    "left_arm", np.array([0.2936, -0.2295, -0.3883, 1.3653, -0.3679]),
    np.array([0.4145, 1.5157, 0.7542, 1.3328, 0.0691]), Mode.POSITION, 1.0, 75e3, "l_hand",
    np.array([0.0268, 0.0162, -0.0227]), np.array([-0.2463, -0.2475, 0.0601]), 100.0, 1,
)  # fmt: skip
"""A blow of the hand that nobody who stands there can escape."""


class Jumps(RigidRobot):
    """Its encoder of the left shoulder's roll jumps by 25 degrees when the arm has met somebody."""

    def read(self) -> Reading:
        told, first = super().read(), self.felt["person"].first
        if first is None or self.time < first + FELT_AFTER:
            return told
        position = told.joints.position.copy()
        position[ROLL] += np.deg2rad(25.0)
        return replace(told, joints=replace(told.joints, position=read_only(position)))


def test_with_a_wrong_encoder_a_pressed_person_bears_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """They bore 164 N for ever."""
    monkeypatch.setattr(squeezed, "RigidRobot", Jumps)
    after = squeeze(ROBOT, TRIAL, settings=ANSWERS)
    assert after.state == "STOP"
    assert after.over <= 0.3
    assert max(after.half, after.late) <= 30.0


def felt(part: str, force: float) -> Contacts:
    rows = np.zeros(1, CONTACT)
    rows["identity"], rows["force"], rows["n_T"] = 7, force, [1.0, 0.0, 0.0]
    site = Site("skin", part, "forearm")
    return Contacts(
        (site,), np.zeros(1), np.zeros(1, np.int64), rows, np.zeros(2, np.int64), np.zeros(0, TAXEL)
    )


def eased(
    *, part: str = "left_arm", force: float = 20.0, code: Code = Code.ENCODER_JUMPED,
    asked: float | None = None, powered: bool = True, load: float = 0.0, lean: float | None = None,
) -> dict[int, float]:  # fmt: skip
    """Which shares of stiffness the gate sends by itself when skin feels a force after a stop, with a `load`
    [kg] in the hand; or with an arm that hangs along a torso that leans forward [rad]."""
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.1, settings=ANSWERS, streams=True)
    gate.load("left_arm", load)
    angles, found = np.array(initial_position(ROBOT)), dict[int, float]()
    if lean is not None:
        angles[[PLACE[f"l_{joint}"] for joint in ("shoulder_pitch", "shoulder_yaw", "elbow")]] = 0.0, 0.0, 0.3
        angles[[ROLL, PLACE["torso_pitch"]]] = 0.1, lean
    for step in range(60):
        now = step * PERIOD
        orders = [position_command([ROLL], [angles[ROLL]])] if step == 0 else []
        if asked is not None and step == 1:
            one = np.array([ROLL])
            orders = [PlatformCommand(Mode.STIFFNESS, one, np.array([asked]), np.ones(1))]
        if step == 20:
            gate.stop(Reason(code, "of the test"))
        joints = reading(angles, now)
        if not powered and step > 20:
            joints = replace(joints, powered=np.arange(len(angles)) != ROLL)
        safe = gate.step(orders, joints, now, contacts=felt(part, force if step > 30 else 0.0))
        if step > 20:
            assert not (found and safe.stiffness), "once"
            found |= safe.stiffness
            assert gate.state is GateState.STOP
    return found


def test_a_part_is_eased_as_far_as_its_weight_is_held() -> None:
    found = eased()
    names = {ROBOT.servos[servo].name for servo in found}
    assert "l_shoulder_roll" in names
    assert all(name.startswith(("l_shoulder", "l_elbow", "l_wrist")) for name in names)
    torque: Array = np.abs(Gravity(ROBOT).torques(np.array(initial_position(ROBOT))))
    for servo, share in found.items():
        limit = ROBOT.servos[servo].limits.torque
        assert limit is not None
        assert share * limit >= 2.0 * torque[servo], "its weight is far from its torque"
        assert 0.1 <= share < 1.0


@pytest.mark.parametrize(
    "case",
    [
        {"force": 12.0},
        {"code": Code.SERVO_OFF},
        {"code": Code.OTHER},
        {"part": "left_fingers", "force": 12.0},
        {"part": "torso"},
    ],
    ids=["a light touch", "a servo is off", "a stop for another cause", "fingers", "a waist"],
)
def test_nothing_else_is_eased(case: dict[str, object]) -> None:
    assert not eased(**case)  # type: ignore[arg-type]


def test_no_joint_becomes_stiffer_and_none_is_switched_on() -> None:
    assert ROLL not in eased(asked=0.02)
    assert ROLL not in eased(powered=False)
    assert len(eased(powered=False)) > 1


def test_what_a_hand_carries_is_held() -> None:
    empty, full = eased(), eased(load=1.0)
    assert full.get(ROLL, 1.0) > empty[ROLL] + 0.1


def arm() -> Group:
    groups = make_groups(ROBOT, groups_of(ROBOT), {}, stands=False)[0].values()
    group = next(one for one in groups if "left_arm" in one.parts)
    group.push = np.zeros(len(group.servos))
    return group


def bears(group: Group, position: Array, torque: Array, now: float, *, ahead: float = 0.0) -> Seen:
    """A group whose joints bear `torque` (k,) [N m]. References are 1 degree `ahead`, if they are, and go on
    with that speed [rad/s]."""
    whole, nothing = np.zeros(len(position)), np.zeros(len(group.servos))
    whole[group.servos] = torque
    joints = replace(reading(position, now), torque=read_only(whole))
    here, modes = position[group.servos], (Mode.POSITION,) * len(nothing)
    asked = Reference(group.servos, modes, here + np.deg2rad(1.0) * (ahead > 0.0), nothing + ahead, nothing)
    own = np.ones(len(nothing), bool)
    return Seen(
        joints, asked, group.servos, here, pull=nothing, own=own, errors=nothing, bounds=nothing,
        weights=nothing, place=0, felt=Felt(), loose=nothing, bears=nothing,
    )  # fmt: skip


def test_where_references_still_go_on_into_somebody_a_part_gets_so_soft_that_they_may_brake() -> None:
    """They run on by 6.7 degrees, with all the stiffness that is left."""
    group = arm()
    position, shares = np.array(initial_position(ROBOT)), list[Array]()
    easing, torque = Easing(ROBOT, OwnWeight(ROBOT)), np.full(len(group.servos), 5.0)
    easing.load(ROBOT, {})
    for now, ahead in enumerate((0.0, 2.0)):
        group.sags = Sags(group.servos)
        seen = bears(group, position, torque, float(now), ahead=ahead)
        easing.yields(group, seen, np.zeros(len(position)), np.zeros(len(torque), bool), float(now))
        shares.append(group.sags.shares.copy())
    assert (shares[1] <= shares[0]).all()
    assert (shares[1] < 0.5 * shares[0]).any()


def test_a_joint_that_still_presses_holds_no_more_than_its_weight() -> None:
    """On its way back it must overcome its friction, too."""
    group = arm()
    position, shares = np.array(initial_position(ROBOT)), list[Array]()
    easing, torque = Easing(ROBOT, OwnWeight(ROBOT)), np.full(len(group.servos), 5.0)
    easing.load(ROBOT, {})
    for now, push in enumerate((-1.0, 1.0)):
        group.sags, group.push = Sags(group.servos), np.full(len(torque), push)
        seen = bears(group, position, torque, float(now))
        easing.yields(group, seen, np.zeros(len(position)), np.zeros(len(torque), bool), float(now))
        shares.append(group.sags.shares.copy())
    assert (shares[1] <= shares[0]).all()
    assert (shares[1] < 0.5 * shares[0]).any()


@pytest.mark.parametrize(
    ("torque", "push", "least"), [(20.0, 1.0, 0.001), (1.8, 1.0, 0.01), (20.0, -1.0, 0.01)]
)
def test_only_a_joint_that_presses_with_more_than_friction_gets_softer_than_a_hundredth(
    torque: float, push: float, least: float
) -> None:
    """A Talos' shoulder pressed with 72 N m at a hundredth; a G1's elbow that pressed nobody arrived late."""
    group = arm()
    position, torques = np.array(initial_position(ROBOT)), np.full(len(group.servos), torque)
    easing, free = Easing(ROBOT, OwnWeight(ROBOT)), np.zeros(len(group.servos), bool)
    easing.load(ROBOT, {})
    group.push = np.full(len(torques), push)
    for count in range(60):
        seen = bears(group, position, torques, 0.05 * count)
        easing.yields(group, seen, np.zeros(len(position)), free, 0.05 * count)
    assert group.sags.shares[0] == least


@pytest.mark.parametrize(("behind", "factor"), [(False, 1.0), (True, 1.5)])
def test_on_a_way_back_joints_bear_little_more_than_their_weight_and_friction(
    behind: bool, factor: float
) -> None:
    """One that stays behind its reference gets stiffness back, as much as holds its weight."""
    group = arm()
    position, count = np.array(initial_position(ROBOT)), len(group.servos)
    limits = np.array([servo.limits.torque for servo in ROBOT.servos], float)
    easing = Easing(ROBOT, OwnWeight(ROBOT))
    easing.load(ROBOT, {})
    weighs = Gravity(ROBOT).torques(position)
    holds = 1.5 * (np.abs(weighs) + 0.05 * limits)[group.servos]

    def bearing(torque: Array, now: float, behind: bool) -> None:
        easing.yields(group, bears(group, position, torque, now), weighs, np.full(count, behind), now)

    torque = 0.5 * limits[group.servos]
    bearing(torque, 1.0, False)
    most = group.sags.shares.copy()
    assert (most * torque <= holds * 1.001).all()
    bearing(torque, 1.01, False)
    np.testing.assert_array_equal(group.sags.shares, most, "no reading told of the new shares yet")
    bearing(torque, 1.04, False)
    soft = group.sags.shares.copy()
    assert (soft < most).all()
    bearing(0.2 * holds, 1.08, behind)
    np.testing.assert_allclose(group.sags.shares, factor * soft, rtol=0.01)
    for step in range(20):
        bearing(0.2 * holds, 1.12 + 0.04 * step, True)
    np.testing.assert_allclose(group.sags.shares, most, rtol=0.01)


def test_a_waist_goes_back_stiffly() -> None:
    """With a tenth of its stiffness the upper body of a standing G1 leaned by 16 degrees."""
    robot = load_robot("g1")
    gate = Gate(robot, period=PERIOD, stale_after=0.1, streams=True)
    waist = [servo.index for servo in robot.servos if servo.name.startswith("waist")]
    yaw, here, shares, told = waist[0], np.array(initial_position(robot)), set[int](), list[str]()
    turns = PlatformCommand(Mode.POSITION, np.array([yaw]), here[[yaw]] + 1.0, np.array([0.5]))
    for step in range(300):
        safe = gate.step([turns] if step == 20 else [], reading(here, step * PERIOD), step * PERIOD)
        here[safe.servos] = safe.position
        here[yaw] = min(here[yaw], 0.15)  # somebody stops it
        shares |= {*safe.stiffness}
        told += [one.text for one in safe.clamped]
    assert any("met something" in one and "it goes back" in one for one in told)
    assert not any("softly" in one for one in told)
    assert shares.isdisjoint(waist)


def test_a_torso_that_leans_does_not_change_which_way_is_down() -> None:
    """An arm that hangs along a torso at 60 degrees weighs on its shoulder."""
    pitch = PLACE["l_shoulder_pitch"]
    assert eased(lean=np.deg2rad(60.0)).get(pitch, 1.0) > eased(lean=0.0)[pitch] + 0.1


class Softened:
    """A left shoulder that got a smaller share of its stiffness while it pressed somebody, and was reset. At
    its full stiffness it hangs 0.3 degrees low."""

    def __init__(self) -> None:
        self.gate = Gate(ROBOT, period=PERIOD, stale_after=0.1, settings=ANSWERS, streams=True)
        self.angles, self.now = np.array(initial_position(ROBOT)), 0.0
        self.share, self.shares, self.told = 1.0, list[tuple[float, float]](), list[str]()
        self.step(position_command([ROLL], [self.angles[ROLL]]))
        self.gate.stop(Reason(Code.ENCODER_JUMPED, "of the test"))
        for step in range(40):
            self.step(force=20.0 if step < 20 else 0.0)
        self.softest = self.share
        self.told.clear()
        self.gate.reset()

    def step(self, *orders: PlatformCommand, force: float = 0.0) -> None:
        safe = self.gate.step(
            orders, reading(self.angles, self.now), self.now, contacts=felt("left_arm", force)
        )
        if ROLL in safe.stiffness:
            self.share = safe.stiffness[ROLL]
            self.shares.append((self.now, self.share))
        for servo, reference in zip(safe.servos.tolist(), safe.position.tolist(), strict=True):
            low = np.deg2rad(0.3) / self.share if servo == ROLL else 0.0
            self.angles[servo] += 0.2 * (reference - low - self.angles[servo])
        self.told += [one.text for one in safe.clamped if one.code is Code.CONTACT]
        self.now += PERIOD

    def raised(self) -> PlatformCommand:
        return position_command([ROLL], [self.angles[ROLL] + 0.2])


def test_after_a_reset_a_part_stays_soft_until_it_is_commanded_and_then_gets_stiff_slowly() -> None:
    """It stayed soft until a STIFFNESS order."""
    arm = Softened()
    assert arm.softest < 0.3
    for _ in range(100):
        arm.step()
    assert arm.share == arm.softest, "reset moves nothing"
    before = (arm.now, arm.share)
    arm.step(arm.raised())
    for _ in range(400):
        arm.step()
    assert arm.share == 1.0
    shares = [before, *(one for one in arm.shares if one[0] > before[0])]
    for (earlier, less), (later, more) in pairwise(shares):
        assert 0.0 < more - less <= 0.0501
        assert later - earlier >= 0.099 or less == arm.softest
    assert not arm.told, "its own motion is no contact"
    assert arm.gate.state is GateState.RUN


def test_a_soft_part_that_touches_somebody_gets_no_stiffer() -> None:
    arm = Softened()
    arm.step(arm.raised())
    for _ in range(50):
        arm.step()
    there = arm.share
    for _ in range(100):
        arm.step(force=8.0)
    assert arm.share <= there + 0.0501
    for _ in range(400):
        arm.step()
    assert arm.share == 1.0


@pytest.mark.parametrize(("bent", "met"), [(-5.0, False), (5.0, True)], ids=["sinks", "is lifted"])
def test_a_joint_told_to_be_soft_sinks_and_only_somebody_lifts_it(bent: float, met: bool) -> None:
    """At a fifth of its stiffness, within the second in which it sinks: a lift was taken for a sag."""
    gate, now = Gate(ROBOT, period=PERIOD, stale_after=0.1, settings=ANSWERS, streams=True), 0.0
    angles, raised, seen = np.array(initial_position(ROBOT)), np.deg2rad(70.0), set[str | None]()
    angles[ROLL] = raised
    assert Gravity(ROBOT).torques(angles)[ROLL] > 2.0, "more than friction"
    soft = PlatformCommand(Mode.STIFFNESS, np.array([ROLL]), np.array([0.2]), np.ones(1))
    for step in range(150):
        orders = {0: [position_command([ROLL], [raised])], 60: [soft]}.get(step, [])
        safe = gate.step(orders, reading(angles, now), now)
        low = np.deg2rad(bent) * min(max(step - 65, 0) / 30.0, 1.0)
        angles[safe.servos] = safe.position + low * (safe.servos == ROLL)
        seen |= {one.joint for one in safe.met}
        now += PERIOD
    assert seen == ({"l_shoulder_roll"} if met else set())


def test_an_order_for_stiffness_is_the_last_word() -> None:
    arm = Softened()
    arm.step(PlatformCommand(Mode.STIFFNESS, np.array([ROLL]), np.array([0.5]), np.ones(1)))
    arm.step(arm.raised())
    for _ in range(400):
        arm.step()
    assert arm.share == 0.5
