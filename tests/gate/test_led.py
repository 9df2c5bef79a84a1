"""An arm whose contact a capability handles, and that somebody pushes harder than that."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import reading
from tci.body.generic_body import order_to_platform
from tci.gate.contact.settings import ContactSettings
from tci.gate.gate import Gate, GateSettings, GateState
from tci.messages import Contacts, ExpectContact, GenericCommand, Mode, Order, SwitchMode
from tci.messages.frames import Array
from tci.robot.joint_map import initial_position, joint_map
from tci.testing import TouchedRobot

PERIOD = 0.01
HANDLED, HARD = 15.0, 25.0
"""Forces [N]: what the capability handles, and what somebody pushes with later."""
SPEED = 0.1
"""Speed [m/s] of the touched place while it is guided, and of the hand that pushes it on."""


class Pushed:
    """A NAO's left arm that follows at once, and a hand on its forearm."""

    def __init__(self) -> None:
        self.skin = TouchedRobot("nao")
        self.robot, self.now = self.skin.robot, 0.0
        self.gate = Gate(
            self.robot, period=PERIOD, stale_after=0.05, streams=True,
            settings=GateSettings(contact=ContactSettings()),
        )  # fmt: skip
        self.joints = joint_map(self.robot, "left_arm")
        self.angles = np.array(initial_position(self.robot))
        first = TouchedRobot("nao")
        seen = first.perceive("left_forearm", force=5.0)
        (contact,) = seen.contacts
        jacobian = first.body.jacobian(seen, contact)
        into = jacobian.T @ contact.n_T
        self.way: Array = into / float(into @ into)
        """Way (5,) [rad/m] of the arm by which the touched place goes into the hand."""
        self.into: Array = into
        goes = jacobian @ -self.way / np.linalg.norm(jacobian @ self.way)
        side = np.cross(goes, [0.0, 0.0, 1.0])
        self.along: Array = side / np.linalg.norm(side) - 0.3 * goes
        self.along /= np.linalg.norm(self.along)
        self.answers: list[str] = []

    @property
    def here(self) -> float:
        """How far into the hand the place is [m], from where it began."""
        begun = self.joints.to_generic(np.array(initial_position(self.robot)))
        return float(self.into @ (self.joints.to_generic(self.angles) - begun))

    def step(
        self,
        force: float,
        asked: float | None = None,
        pushed: float = 0.0,
        *,
        handled: bool = True,
        other: float = 0.0,
        along: bool = False,
        ends: float = -np.inf,
    ) -> float:
        """One period with a `force` [N]. A capability, by which the contact may be `handled`, asks for the
        speed `asked` [m/s] into the hand, and the hand pushes the place on by `pushed` [m].

        Somebody on the other side presses with the force `other` [N]; the patch tells a normal `along` the
        way on which the place leaves the hand, 17 degrees backward; somebody whom no skin feels stops the
        place at `ends` [m].

        Returns how far into the hand the arm's reference is, from where its joints are [m].
        """
        seen = self.skin.perceive("left_forearm" if force else None, force=force)
        contacts = seen.contacts
        if other:
            second = contacts.changed(identity=1000, force=other, n_T=-contacts.n_T)
            contacts = Contacts.of([*contacts, *second])
        if along and force:
            contacts = contacts.changed(n_T=self.along)
        orders: list[Order] = [] if self.gate.counts.steps else [SwitchMode("left_arm", Mode.VELOCITY)]
        if asked is not None:
            command = GenericCommand("left_arm", Mode.VELOCITY, asked * self.way)
            orders += [command, *[ExpectContact("left_arm", HANDLED)] * handled]
        sent = [order_to_platform(self.robot, one, self.angles) for one in orders]
        safe = self.gate.step(sent, reading(self.angles, self.now), self.now, contacts=contacts)
        self.answers += [one.answer for one in safe.met if one.part == "left_arm"]
        reference = self.angles.copy()
        reference[safe.servos] = safe.position
        ahead = self.joints.to_generic(reference) - self.joints.to_generic(self.angles)
        self.angles = reference
        if self.here < ends:
            self.angles[self.joints.servos] = self.joints.to_robot(
                self.joints.to_generic(self.angles) + (ends - self.here) * self.way, self.angles
            )
        if pushed:
            led = self.joints.to_generic(self.angles) - pushed * self.way
            self.angles[self.joints.servos] = self.joints.to_robot(led, self.angles)
        self.now += PERIOD
        return float(self.into @ ahead)


def guided(asked: float) -> Pushed:
    """An arm that went at the speed `asked` [m/s] into a hand, for 0.4 s."""
    arm = Pushed()
    for _ in range(5):
        arm.step(0.0)
    for _ in range(40):
        arm.step(8.0, asked=asked)
    return arm


def pushed_on() -> Pushed:
    """An arm that went along with a hand, which then pushed it on, harder than the capability handles."""
    arm = guided(-SPEED)
    for _ in range(20):
        arm.step(HARD, pushed=SPEED * PERIOD)
    return arm


def test_whoever_leads_an_arm_too_hard_is_given_way_to_and_never_pushed_back() -> None:
    arm = guided(-SPEED)
    led = arm.here
    assert led < -0.02
    most = max(arm.step(HARD, pushed=SPEED * PERIOD) for _ in range(40))
    assert most < 1.5 * SPEED * PERIOD, "its reference is at most a period behind the hand"
    assert arm.here < led - 0.02, "it went on with the hand"
    assert set(arm.answers[-20:]) == {"soft"}
    end = arm.here
    for _ in range(150):
        arm.step(0.0)
    assert abs(arm.here - end) < 3e-3, "and stays where it was let go"
    assert arm.gate.state is GateState.RUN


def leaving() -> Pushed:
    """An arm that has gone away from where the hand will be for .4 s."""
    arm = Pushed()
    for _ in range(5):
        arm.step(0.0)
    for _ in range(40):
        arm.step(0.0, asked=-SPEED, handled=False)
    return arm


def test_whoever_catches_up_with_a_moving_arm_is_not_pressed_by_its_way_back() -> None:
    """Nothing handles the contact, and skin felt it begin while the arm moved: away from the hand."""
    arm = leaving()
    most = max(arm.step(HARD, pushed=SPEED * PERIOD) for _ in range(60))
    assert most < 1.5 * SPEED * PERIOD, "its reference is at most a period behind the hand"
    assert arm.gate.state is GateState.RUN


def left(**what: float | bool) -> tuple[Pushed, float]:
    """An arm that leaves a hand, which presses it all the same; how far its reference then went out [m]."""
    arm = leaving()
    begun = arm.here
    ahead = [arm.step(HARD, asked=-SPEED, handled=False, **what) for _ in range(60)]  # type: ignore[arg-type]
    return arm, begun - min(arm.here + one for one in ahead)


def test_an_arm_that_leaves_whoever_catches_up_with_it_goes_on() -> None:
    arm, out = left()
    assert out > 0.03
    assert arm.gate.state is GateState.RUN


def test_an_arm_that_leaves_one_hand_does_not_go_on_into_another() -> None:
    arm, out = left(other=20.0)
    assert out < 0.01
    assert "retreat" in arm.answers


def test_an_arm_that_leaves_a_hand_does_not_press_whom_no_skin_feels() -> None:
    """Somebody behind it stops it; what it then presses with is by how far its reference is ahead."""
    ends = leaving().here - 0.01
    arm, _ = left(ends=ends)
    last = [arm.step(HARD, asked=-SPEED, handled=False, ends=ends) for _ in range(40)]
    assert min(last) > -5e-3
    assert arm.gate.state is GateState.RUN


def test_an_arm_that_goes_along_whoever_presses_it_may_press_them_and_stops() -> None:
    """A patch tells where its outside is to some 30 degrees."""
    assert left(along=True)[1] < 0.01


def test_an_arm_that_leaves_somebody_does_not_go_on_into_whoever_follows_it() -> None:
    """It came a longer way, from where the hand is now. The hand, of 20 N/mm, followed it with 8 N."""
    arm = Pushed()
    for _ in range(5):
        arm.step(0.0)
    for speed, count in ((-SPEED, 60), (SPEED, 15)):
        for _ in range(count):
            arm.step(0.0, asked=speed, handled=False)
    for _ in range(3):
        arm.step(HARD, asked=SPEED, handled=False)
    met = arm.here
    for _ in range(30):
        arm.step(8.0)
    assert arm.answers[-1] == "retreat"
    there, forces = arm.here, [8.0]
    assert there < met - 2e-3
    for _ in range(300):
        arm.step(forces[-1])
        forces.append(max(0.0, 8.0 + 20e3 * (arm.here - there)))
    assert max(forces) < 12.0
    assert forces[-1] <= 5.0


def test_an_arm_that_creeps_into_somebody_leaves_them() -> None:
    """More slowly than what counts as motion, so that its part seemed to rest."""
    arm = Pushed()
    for _ in range(40):
        arm.step(0.0, asked=0.0, handled=False)
    there, forces = arm.here, [0.0]
    for _ in range(400):
        arm.step(forces[-1], asked=0.003, handled=False)
        forces.append(max(0.0, 20e3 * (arm.here - there)))
    assert "retreat" in arm.answers
    assert max(forces) < 60.0


def test_a_patch_that_reports_a_force_for_ever_drives_no_arm_far() -> None:
    arm = Pushed()
    for _ in range(5):
        arm.step(0.0)
    for _ in range(20):
        arm.step(0.0, asked=SPEED, handled=False)
    for _ in range(1000):
        arm.step(HARD)
    assert arm.gate.state is GateState.RUN
    way = np.abs(
        arm.joints.to_generic(arm.angles) - arm.joints.to_generic(np.array(initial_position(arm.robot)))
    )
    assert np.rad2deg(way.max()) < 5.0


def test_an_arm_that_went_into_somebody_goes_back_as_ever() -> None:
    """Also if a capability declared the contact: nobody led it there."""
    arm = guided(SPEED)
    went = arm.here
    assert went > 0.02
    for _ in range(60):
        arm.step(HARD)
    assert "retreat" in arm.answers
    assert arm.here < went - 5e-3


def test_an_arm_that_was_led_and_then_goes_into_the_same_hand_goes_back() -> None:
    arm = pushed_on()
    assert "soft" in arm.answers
    for _ in range(60):
        arm.step(8.0, asked=SPEED)
    for _ in range(10):
        arm.step(HARD, asked=SPEED)
    assert arm.answers[-1] == "retreat"


@pytest.mark.parametrize("speed", [0.003, 0.02])
def test_an_arm_that_was_led_and_creeps_into_the_hand_leaves_it_and_is_not_led_back_into_it(
    speed: float,
) -> None:
    """The hand, of 20 N/mm, stands where it led the arm to. It got 270 N from an arm that crept, and 1100 N
    from one whose way back ended where it had been led from."""
    arm = pushed_on()
    there, force, forces = arm.here, 20.0, list[float]()
    for _ in range(400):
        arm.step(force, asked=speed)
        force = max(0.0, 20.0 + 20e3 * (arm.here - there))
        forces.append(force)
    assert "retreat" in arm.answers
    assert max(forces) < 60.0
    assert forces[-1] < 25.0


def test_a_declaration_ends_when_the_clock_goes_back() -> None:
    arm = Pushed()
    arm.now = 10.0
    for _ in range(40):
        arm.step(8.0, asked=0.0)
    assert arm.answers[-1] == "expected"
    arm.now -= 5.0
    for _ in range(10):
        arm.step(8.0)
    assert arm.answers[-1] == "told"
