"""Task: reach a place through a field of poles, and press none of them hard (whole-arm reaching in clutter,
Jain et al. 2013, doi:10.1177/0278364912471865)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody, slowed
from tci.capabilities.capability import Capability
from tci.capabilities.policy.observations import Observation, View
from tci.capabilities.policy.spec import PolicySpec
from tci.errors import TciError
from tci.learn.pole_field import POLES, field
from tci.learn.task import Scene, TouchTask, nothing
from tci.messages import Command, Contact, GenericCommand, Mode, Perception, SwitchMode
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import joint_map

NEAR = 0.1
"""Distance [arm lengths] at which the hand has reached its place."""
LOAD = 10.0
"""Force [N] on the skin above which a reach is not gentle: what a shoulder is touched with in passing."""
LATEST = 5
"""Torques of which the median counts, since a change of speed takes a torque in one period or two."""
SMOOTH = 0.1
"""Time constant [s] of torques that no felt contact explains."""
STARTS = 1.0
"""Acceleration [rad/s2] with which a robot that listens to torques starts: without a bound it takes its own
inertia for a pole."""
QUICKER = 3.0
"""Factor, at most, by which the way along what is met is quicker than its share of the straight way: without
it an arm creeps where it slides nearly across its way, and a larger one answers to noise."""
FRICTION = 1.0
"""Coefficient of friction, at most, of what is felt: torques tell of the friction, skin does not, and who
takes it for a push that no skin feels comes to rest instead of sliding. Assumed."""


def hand(view: View) -> Array:
    """Where the hand is (3,), in the unit of Cartesian commands: arm lengths from the shoulder."""
    assert view.perception.joints is not None
    return view.body.reach(view.part).place(view.perception.joints.position)


def reach_reward(view: View) -> dict[str, float]:
    """`way` is the share of the way from `home` to the place that is done: 1 there, 0 for who stands still,
    below 0 farther away. `load` is the force [N] on the skin above 10 N, divided by 10 N."""
    assert view.perception.joints is not None
    position = np.array(view.perception.joints.position)
    own = joint_map(view.body.robot, view.part)
    left = np.linalg.norm(hand(view) - view.goal)
    position[own.servos] = own.to_robot(view.home, position)
    whole = np.linalg.norm(view.body.reach(view.part).place(position) - view.goal)
    force = max((one.force for one in view.perception.contacts if one.part == view.part), default=0.0)
    return {"way": float(1.0 - left / whole), "load": -max(force / LOAD - 1.0, 0.0)}


@dataclass(frozen=True, slots=True, eq=False)
class Reaching:
    """Memory of `ReachThrough`."""

    place: Array
    """Posture (n,) [rad] at the place."""
    rest: Array
    """Torques (n,) [N m] of the generic joints at the start; empty where the robot measures none."""
    torques: tuple[Array, ...]
    """The latest `LATEST` torques (n,) [N m]."""
    unfelt: Array
    """Torques (n,) [N m] on the joints that felt contacts don't explain, smoothed over `SMOOTH`."""
    rates: Array
    """Speeds (n,) [rad/s] that it ordered last."""
    stamp: float
    """When that was [s]."""


@dataclass(frozen=True)
class ReachThrough(Capability[Reaching | None]):
    """Moves the hand to a place, slowly, and slides along what it meets (as `GenericBody.yield_to`).

    What no skin feels it notices by joint torques that felt contacts don't explain, on robots that measure
    torques; the arm is taken to be without weight, as in these worlds. Raises TciError for a number out of
    range.
    """

    part: str
    goal: tuple[float, ...]
    """Place (3,) of the hand, in the unit of Cartesian commands."""
    cap: float = 6.0
    """Force [N] that it keeps where it slides."""
    speed: float = 0.1
    """Largest speed [m/s] of the hand. A first blow is that of the speed, of the stiffness that is met, and
    of `delay`."""
    damping: float = 150.0
    """[N s/m]: twice the stiffness of a pole times the delay of skin, gate and servo (0.05 s)."""
    lever: float = 0.08
    """Distance [m] from an axis at which it takes an unfelt force to act: half an upper arm. A force that is
    nearer is larger than it takes it to be."""
    friction: tuple[float, ...] = ()
    """Viscous friction [N m s/rad] of each of the robot's servos; empty: none."""

    def __post_init__(self) -> None:
        for name in ("cap", "speed", "damping", "lever"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"reach: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> None:
        return None

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        return (SwitchMode(self.part, Mode.VELOCITY),)

    def step(
        self, memory: Reaching | None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], Reaching]:
        now = perception.posture[self.part]
        memory = memory or self._begun(perception, body)
        elapsed = perception.stamp - memory.stamp
        want = 4.0 * (memory.place - now)
        length = sum(one.length for one in body.robot.part(self.part).segments)
        want *= min(1.0, self.speed / max(float(np.abs(want).sum()) * length, 1e-9))
        own = [one for one in perception.contacts if one.part == self.part]
        into = [body.jacobian(perception, one).T @ one.n_T for one in own]
        most = [(self.cap - one.force) / self.damping for one in own]
        memory = self._listen(memory, own, elapsed, perception, body)
        unfelt = memory.unfelt
        if (size := float(np.linalg.norm(unfelt))) > 0.0:
            into.append(-self.lever * unfelt / size)
            most.append((self.cap - size / self.lever) / self.damping)
        if into:
            along = slowed(want, np.array(into), most)
            quicker = min(QUICKER, self.speed / max(float(np.abs(along).sum()) * length, 1e-9))
            want = slowed(max(quicker, 1.0) * along, np.array(into), most)
        if memory.rest.size:
            faster = np.where(want * memory.rates < 0.0, 0.0, np.abs(memory.rates)) + STARTS * elapsed
            want = np.clip(want, -faster, faster)
        memory = replace(memory, rates=read_only(want), stamp=perception.stamp)
        return (GenericCommand(self.part, Mode.VELOCITY, memory.rates),), memory

    def _begun(self, perception: Perception, body: GenericBody) -> Reaching:
        assert perception.joints is not None
        found, _ = body.reach(self.part).solve(self.goal, perception.joints.position)
        place = joint_map(body.robot, self.part).to_generic(found)
        rest, still = self._torques(perception, body), np.zeros(len(place))
        return Reaching(place, rest, (), np.zeros(rest.size), still, perception.stamp)

    def _listen(
        self, memory: Reaching, felt: list[Contact], elapsed: float, perception: Perception, body: GenericBody
    ) -> Reaching:
        """What the torques say."""
        if not memory.rest.size:
            return memory
        torques = (*memory.torques, self._torques(perception, body))[-LATEST:]
        unfelt = memory.rest - np.median(torques, axis=0)
        for one in felt:
            jacobian = body.jacobian(perception, one)
            unfelt = unfelt - jacobian.T @ one.f_T
            across = (np.eye(3) - np.outer(one.n_T, one.n_T)) @ jacobian
            rubs = np.linalg.lstsq(across.T, unfelt, rcond=1e-6)[0]
            most = FRICTION * one.force
            unfelt = unfelt - across.T @ rubs * min(1.0, most / max(float(np.linalg.norm(rubs)), 1e-9))
        share = 1.0 - np.exp(-elapsed / SMOOTH)
        return replace(memory, torques=torques, unfelt=memory.unfelt + share * (unfelt - memory.unfelt))

    def _torques(self, perception: Perception, body: GenericBody) -> Array:
        """Torques (n,) [N m] that hold the generic joints, without friction; empty if the robot measures
        none: it has no torque mode, and nobody knows its servos' torques. A simulated NAO tells what no NAO
        does."""
        joints, own = perception.joints, joint_map(body.robot, self.part)
        assert joints is not None
        servos = [body.robot.servos[servo] for servo in own.servos]
        able = all(Mode.TORQUE in one.modes or "torque" not in one.limits.assumed for one in servos)
        if not able or joints.torque is None or not np.isfinite(joints.torque[own.servos]).all():
            return np.zeros(0)
        torque = joints.torque
        if self.friction:
            torque = torque - np.array(self.friction) * joints.velocity
        found = np.zeros(len(perception.posture[self.part]))
        slope = own.slope(joints.position)
        found[own.ids] = np.linalg.lstsq(slope.T, torque[own.servos], rcond=None)[0]
        return found

    def claims(self, memory: Reaching | None) -> frozenset[str]:
        return frozenset({self.part})


def _baseline(scene: Scene) -> ReachThrough:
    model = scene.world.model
    names = [servo.joint for servo in scene.robot.servos]
    friction = [0.0 if name is None else float(model.joint(name).damping[0]) for name in names]
    return ReachThrough(scene.part, tuple(scene.goal.tolist()), friction=tuple(friction))


REACH = TouchTask(
    reward=reach_reward,
    baseline=_baseline,
    touch=nothing,
    goal=field,
    observations={"hand": Observation(hand)},
    policy=PolicySpec(
        observations=("posture", "velocity", "contacts", "hand", "goal"),
        mode="velocity",
        action_scale=(1.0,) * 5,
    ),
    success=lambda view: float(np.linalg.norm(hand(view) - view.goal)) < NEAR,
    obstacles=POLES,
    duration=12.0,
)
"""Bring the hand to a place that is half an arm's length away or more, through 2 to 6 poles, and press none
of them hard. The goal is the place (3,). The baseline slides along what it meets. Success: the hand is within
a tenth of an arm's length of its place."""
