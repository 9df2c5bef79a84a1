"""A reflex above a task: who moves which part, in which mode, and what happens to what was interrupted."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tci
from helpers.touches import BODY, see
from helpers.turning import Turn
from tci.body.generic_body import GenericBody
from tci.capabilities.arbiter import Arbiter
from tci.capabilities.capability import Capability
from tci.capabilities.play_gesture import Phase, PlayGesture
from tci.capabilities.wrapper import CapabilityWrapper
from tci.cli.session import poke_skin
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import CommandError, TciError
from tci.gate.gate import Gate, GateState
from tci.gestures.gesture import Gesture, fit
from tci.lab.authoring.dense_skin import with_skin_rate
from tci.messages import GenericCommand, Mode, Order, Perception, PlatformCommand, SwitchMode
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.runtime.loop import Tick, run

LEFT, RIGHT = "left_arm", "right_arm"
SLOWEST = 0.033
"""Longest time [s] from a touch to the first motion away."""
MOTION = float(np.deg2rad(0.05))


def position(part: str, value: float) -> GenericCommand:
    return GenericCommand(part, Mode.POSITION, np.full(5, value))


def velocity(part: str, value: float) -> GenericCommand:
    return GenericCommand(part, Mode.VELOCITY, np.full(5, value))


@dataclass(frozen=True)
class Script(Capability[tuple[int, tuple[str, ...]]]):
    """In each step returns the orders of its script and claims the parts of its script; its memory also lists
    what it was told."""

    orders: Sequence[Sequence[Order]] = ()
    claimed: Sequence[Iterable[str]] = ()
    first: Sequence[Order] = ()
    mine: frozenset[str] | None = None

    def init(self, body: GenericBody) -> tuple[int, tuple[str, ...]]:
        return 0, ()

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return tuple(self.first)

    def step(self, memory: Any, perception: Perception, body: GenericBody) -> Any:
        count, told = memory
        orders = self.orders[count] if count < len(self.orders) else ()
        return tuple(orders), (count + 1, (*told, f"feels {len(perception.contacts)}"))

    def claims(self, memory: Any) -> frozenset[str]:
        count = memory[0] - 1
        return frozenset(self.claimed[count] if 0 <= count < len(self.claimed) else ())

    def pause(self, memory: Any, taken: frozenset[str], *seen: Any) -> Any:
        return (), (memory[0], (*memory[1], f"without {sorted(taken)}"))

    def resume(self, memory: Any, taken: frozenset[str], last: Any, *seen: Any) -> Any:
        return last, (memory[0], (*memory[1], f"again, without {sorted(taken)}"))


def play(arbiter: Arbiter, count: int) -> tuple[list[list[tuple[Any, ...]]], Any]:
    """Orders of `count` steps in short words, and the memory."""
    memory, told = arbiter.init(BODY), []
    for step in range(count):
        orders, memory = arbiter.step(memory, see(stamp=0.01 * step), BODY)
        told.append([short(order) for order in orders])
    return told, memory


def short(order: Order) -> tuple[Any, ...]:
    if isinstance(order, SwitchMode):
        return order.part, order.mode.value
    assert isinstance(order, GenericCommand)
    return order.part, order.mode.value, float(order.values[0])


def test_only_who_moves_a_part_tells_of_it() -> None:
    upper, lower = Script([[]], [[LEFT]]), Script([[]], [[LEFT, RIGHT]])
    arbiter = Arbiter([upper, lower, Script()])
    assert arbiter.notes(play(arbiter, 1)[1]) == (f"Script holds {LEFT}", f"Script holds {RIGHT}")
    same = Arbiter([upper, Script([[]], [[LEFT]]), Script()])
    assert same.notes(play(same, 1)[1]) == (f"Script holds {LEFT}",)


def test_what_a_layer_claims_the_layers_below_cannot_move() -> None:
    upper = Script([[], [position(LEFT, 1.0)], []], [[], [LEFT], [LEFT], []])
    lower = Script([[position(LEFT, 0.1 * k), position(RIGHT, 0.1 * k)] for k in range(1, 6)])
    told, memory = play(Arbiter([upper, lower]), 5)
    moves = [[one for one in step if len(one) == 3] for step in told]
    assert moves == [
        [(LEFT, "position", 0.1), (RIGHT, "position", 0.1)],
        [(LEFT, "position", 1.0), (RIGHT, "position", 0.2)],
        [(RIGHT, "position", pytest.approx(0.3))],
        [(LEFT, "position", pytest.approx(0.3)), (LEFT, "position", 0.4), (RIGHT, "position", 0.4)],
        [(LEFT, "position", 0.5), (RIGHT, "position", 0.5)],
    ]
    assert memory.layers[1].memory[1] == (
        "feels 0", "without ['left_arm']", "feels 0", "feels 0", "again, without []", "feels 0", "feels 0",
    )  # fmt: skip


def test_a_layer_moves_nothing_that_it_does_not_claim_unless_it_is_the_last() -> None:
    upper = Script([[position(LEFT, 1.0), position(RIGHT, 1.0)]], [[LEFT]])
    told, _ = play(Arbiter([upper, Script()]), 1)
    assert [one for one in told[0] if len(one) == 3] == [(LEFT, "position", 1.0)]


def test_each_layer_feels_each_touch() -> None:
    from helpers.touches import touch

    arbiter = Arbiter([Script(claimed=[[LEFT]] * 3), Script(claimed=[[LEFT]] * 3), Script()])
    memory = arbiter.init(BODY)
    for _ in range(3):
        _, memory = arbiter.step(memory, see(touch(0.5, 0.0, [3.0])), BODY)
    assert [layer.memory[1].count("feels 1") for layer in memory.layers] == [3, 3, 3]


def test_a_position_is_ordered_again_and_a_velocity_or_torque_is_not() -> None:
    upper = Script(claimed=[[], [LEFT, RIGHT], []])
    for lower, again in (
        ([position(LEFT, 0.5)], [(LEFT, "position"), (LEFT, "position", 0.5)]),
        ([velocity(LEFT, 0.5)], [(LEFT, "velocity")]),
        ([GenericCommand(LEFT, Mode.TORQUE, np.full(5, 0.5))], [(LEFT, "torque")]),
        ([SwitchMode(LEFT, Mode.IMPEDANCE)], [(LEFT, "impedance")]),
        (
            [GenericCommand(LEFT, Mode.STIFFNESS, np.full(5, 0.25)), position(LEFT, 0.5)],
            [(LEFT, "position"), (LEFT, "stiffness", 0.25), (LEFT, "position", 0.5)],
        ),
    ):
        told, _ = play(Arbiter([upper, Script([lower])]), 3)
        assert told[1:] == [[], again]


def test_a_part_changes_its_mode_with_its_owner() -> None:
    upper = Script([[], [position(LEFT, 1.0)], [position(LEFT, 1.1)]], [[], [LEFT], [LEFT], []])
    lower = Script([[velocity(LEFT, 0.1), velocity(RIGHT, 0.1)]] * 5, first=[SwitchMode(LEFT, Mode.VELOCITY)])
    told, _ = play(Arbiter([upper, lower]), 5)
    assert [[one for one in step if one[0] == LEFT] for step in told] == [
        [(LEFT, "velocity"), (LEFT, "velocity", 0.1)],
        [(LEFT, "position"), (LEFT, "position", 1.0)],
        [(LEFT, "position"), (LEFT, "position", 1.1)],
        [(LEFT, "velocity"), (LEFT, "velocity", 0.1)],
        [(LEFT, "velocity"), (LEFT, "velocity", 0.1)],  # also made up for a switch that a hold refused
    ]
    assert [step.count((RIGHT, "velocity")) for step in told] == [1, 0, 0, 0, 0], "one mode needs no switches"


def test_the_first_orders_of_a_layer_come_when_it_gets_the_part() -> None:
    soft = GenericCommand(LEFT, Mode.STIFFNESS, np.full(5, 0.4))
    upper = Script(
        [[], [GenericCommand(LEFT, Mode.IMPEDANCE, np.full(5, 1.0))]], [[], [LEFT], [LEFT], []],
        first=[SwitchMode(LEFT, Mode.IMPEDANCE), soft],
    )  # fmt: skip
    lower = Script(first=[SwitchMode(LEFT, Mode.VELOCITY)])
    arbiter = Arbiter([upper, lower])
    assert [short(order) for order in arbiter.begin(see(), BODY)] == [(LEFT, "velocity")]
    told, _ = play(arbiter, 4)
    assert told == [
        [],
        [(LEFT, "impedance"), (LEFT, "stiffness", 0.4), (LEFT, "impedance", 1.0)],
        [],
        [(LEFT, "velocity")],
    ]


def test_an_arbiter_is_a_layer_of_another_one() -> None:
    top = Script(claimed=[[], [LEFT], []])
    middle = Script([[position(RIGHT, 1.0)]] * 3, [[RIGHT]] * 3)
    bottom = Script([[position(LEFT, 0.5)]], [[LEFT]] * 3)
    inner = Arbiter([middle, CapabilityWrapper(bottom)])
    told, memory = play(Arbiter([top, inner, Script([[position(LEFT, 9.0)]] * 3)]), 3)
    moves = [[one for one in step if len(one) == 3] for step in told]
    right = (RIGHT, "position", 1.0)
    assert moves == [[right, (LEFT, "position", 0.5)], [right], [right, (LEFT, "position", 0.5)]]
    assert inner.claims(memory.layers[1].memory) == {LEFT, RIGHT}
    assert "without ['left_arm', 'right_arm']" in memory.layers[1].memory.layers[1].memory[1]


def test_it_tells_which_layer_holds_what() -> None:
    arbiter = Arbiter([Script(claimed=[[RIGHT, LEFT]]), Script()])
    _, memory = play(arbiter, 1)
    assert arbiter.notes(memory) == ("Script holds left_arm, right_arm",)


class Silent(Capability[None]):
    """Does not tell what it claims."""

    def init(self, body: GenericBody) -> None:
        return None

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        command = PlatformCommand(Mode.POSITION, np.array([0]), np.zeros(1), np.ones(1))
        return (command,), None


def test_wrong_layers_are_refused_with_what_is_valid() -> None:
    with pytest.raises(TciError, match="valid: at least one capability"):
        Arbiter([])
    with pytest.raises(TciError, match="the class Silent as a layer; valid: instances of"):
        Arbiter([Silent])  # type: ignore[list-item]
    for silent in (Silent(), CapabilityWrapper(Silent()), Arbiter([Script(), Silent()])):
        assert Arbiter([Script(), silent])
        with pytest.raises(TciError, match="does not tell which parts it holds; valid: as the last"):
            Arbiter([silent, Script()])
    with pytest.raises(CommandError, match="Silent commands the robot's own joints; valid: commands"):
        play(Arbiter([Script(), Silent()]), 1)
    loose = Script(first=[SwitchMode("head", Mode.TORQUE)])
    with pytest.raises(CommandError, match=r"Script needs head in torque mode; valid for HeadPitch: posi"):
        Arbiter([loose, Script()]).begin(see(), BODY)


PARTS = ("left_arm", "right_arm", "head")
CLAIMS = st.lists(st.frozensets(st.sampled_from(PARTS)), min_size=6, max_size=6)


@given(st.lists(CLAIMS, min_size=1, max_size=3))
def test_each_part_has_one_owner_in_each_step(claims: list[list[frozenset[str]]]) -> None:
    """Every layer always orders everything; exactly the orders of the owners are carried out, and losers are
    told each change once."""
    orders = [[[position(part, 0.1 * n) for part in PARTS]] * 6 for n in range(len(claims) + 1)]
    layers = [Script(own, claim) for own, claim in zip(orders, [*claims, []], strict=True)]
    told, memory = play(Arbiter(layers), 6)
    for step in range(6):
        owners = {
            part: next((n for n, claim in enumerate(claims) if part in claim[step]), len(claims))
            for part in PARTS
        }
        moves = {one[0]: round(10 * one[2]) for one in told[step] if len(one) == 3}
        assert moves == owners
    for n, layer in enumerate(memory.layers):
        taken = [frozenset().union(*(claim[step] for claim in claims[:n])) for step in range(6)]
        changes = [(a, b) for a, b in zip([frozenset(), *taken], taken, strict=False) if a != b]
        words = [re.split("[ ,]", word)[0] for word in layer.memory[1]]
        assert words.count("without") == sum(bool(b - a) for a, b in changes)
        assert words.count("again") == sum(bool(a - b) for a, b in changes)


# on simulated robots


class AtRest(DriverWrapper):
    """A simulated robot that can change a mode only at rest."""

    def __init__(self, inner: SimulatedDriver) -> None:
        gate = Gate(inner.robot, period=inner.period, stale_after=inner.gate.stale_after, streams=False)
        super().__init__(inner, gate=gate)


def touched(
    name: str, capability: Capability[Any], duration: float, *, streams: bool = True, retire: float = np.inf
) -> tuple[list[Tick], float | None, Any]:
    """A run in which the left forearm is poked: its periods, the time of the touch and the memory."""
    ticks: list[Tick] = []
    with SimulatedDriver(with_skin_rate(load_robot(name), 100.0), seed=2) as simulated:
        driver = simulated if streams else AtRest(simulated)
        poke_skin(simulated)

        def see_tick(tick: Tick) -> None:
            ticks.append(tick)
            if tick.now >= retire:
                simulated.world.finger.retire()

        result = run(driver, capability, duration=duration, observe=see_tick)
        assert not result.refusals, result
        return ticks, simulated.world.finger.first_contact, result.memory


def moves_away(ticks: list[Tick], alone: list[Tick], begin: int, target: Array) -> float:
    """Time [s] at which the left arm has moved by `MOTION` towards `target` since the period `begin`: farther
    than it moves without the reflex, and back from the farthest point of the task's motion."""
    arm, other = ([tick.perception.posture[LEFT] for tick in one[begin:]] for one in (ticks, alone))
    way = (target - arm[0]) / np.linalg.norm(target - arm[0])
    gone, apart = np.array(arm) @ way, (np.array(arm) - np.array(other)) @ way
    turned = gone - np.minimum.accumulate(gone) >= MOTION
    return ticks[begin + int(np.argmax(turned & (apart >= MOTION)))].now


@pytest.mark.parametrize("name", ["nao", "icub"])
@pytest.mark.parametrize("phase", [0.0, 4.0], ids=["from behind", "on the way"])
def test_a_position_reflex_above_a_velocity_task(name: str, phase: float) -> None:
    """Without the arbiter the gate refused the reflex at the touch: nothing moved away."""
    layers = Arbiter([tci.WithdrawalReflex(), Turn(phase)])
    ticks, contact, _ = touched(name, layers, 1.2)
    alone, _, _ = touched(name, Turn(phase), 1.2)
    assert contact is not None
    orders = [(n, one) for n, tick in enumerate(ticks) for one in tick.commands if one.part == LEFT]
    aimed = [(n, one) for n, one in orders if isinstance(one, GenericCommand) and one.mode is Mode.POSITION]
    last, target = aimed[-1]
    away = moves_away(ticks, alone, aimed[0][0], target.values)
    print(f"{name}: away after {away - contact:.3f} s")
    assert not [clamp for tick in ticks for clamp in tick.sent.clamped if clamp.code is Code.SWITCHES_AT_REST]
    assert 0.0 < away - contact <= SLOWEST
    released = next(n for n, _ in orders if n > last)
    arm = ticks[released - 1].perception.posture[LEFT]
    has = GenericBody(load_robot(name)).has_joint(LEFT)
    assert np.abs(arm - target.values)[has].max() < np.deg2rad(3.0), "the touched arm withdraws all the way"


JOINTS = {
    "nao": "LShoulderPitch LShoulderRoll LElbowYaw LElbowRoll",
    "icub": "l_shoulder_pitch l_shoulder_roll l_shoulder_yaw l_elbow",
}


def braked(name: str, task: Turn, seed: int) -> tuple[float, float, float, Array, Array] | None:
    """The time of the touch, when braking began, its told length, all times (n,) [s] and the joints (n, 4)
    [rad] of the physics; None if the finger did not reach the arm."""
    path: list[tuple[float, Array]] = []
    told: list[tuple[float, float]] = []
    with SimulatedDriver(with_skin_rate(load_robot(name), 100.0), seed=seed) as simulated:
        poke_skin(simulated)
        world = simulated.world
        places = [world.model.joint(one).qposadr[0] for one in JOINTS[name].split()]

        def see_tick(tick: Tick) -> None:
            path.append((tick.now, world.data.qpos[places]))
            for one in tick.sent.clamped:
                if one.code is Code.SWITCHES_AT_REST:
                    told.append((tick.now, 1e-3 * float(re.findall(r"in (\d+) ms, at rest", one.text)[0])))

        run(AtRest(simulated), Arbiter([tci.WithdrawalReflex(), task]), duration=0.5, observe=see_tick)
        contact = world.finger.first_contact
    if contact is None or not told or told[0][0] > 0.34:
        return None
    return contact, *told[0], np.array([now for now, _ in path]), np.array([row for _, row in path])


@pytest.mark.parametrize("name", JOINTS)
def test_where_a_mode_changes_at_rest_the_braking_time_is_told_and_kept(name: str) -> None:
    """At random speeds; what the joints of the physics do is compared with what the gate told."""
    random, trials = np.random.default_rng(7), 0
    while trials < 4:
        task = Turn(phase=random.uniform(0.0, 2.0 * np.pi), speed=random.uniform(0.1, 1.5))
        found = braked(name, task, seed=trials)
        if found is None:
            continue
        trials += 1
        contact, begun, braking, times, joints = found
        speed = np.linalg.norm(np.gradient(joints, times, axis=0), axis=1)
        begin, latest = np.searchsorted(times, [begun, begun + braking + 0.05])
        rest = begin + int(np.argmin(speed[begin:latest]))
        way = joints[latest + 20] - joints[rest]
        gone = (joints[rest:] - joints[rest]) @ (way / np.linalg.norm(way))
        away = times[rest + int(np.argmax(gone > MOTION))]
        print(
            f"{name}: braked from {np.rad2deg(speed[begin]):.0f} degrees/s in {times[rest] - begun:.3f} s, "
            f"told {braking:.3f} s, away {away - contact:.3f} s after the touch"
        )
        assert begun - contact <= 0.012, "it brakes in the tick of the touch"
        if speed[begin] > np.deg2rad(5.0):  # else it rests already
            assert abs(times[rest] - begun - braking) <= 0.015
        assert speed[rest] <= np.deg2rad(10.0)
        assert 0.0 < away - contact <= SLOWEST + braking


def test_a_switch_that_a_hold_refused_is_made_up_for() -> None:
    """The gate refuses everything while it holds: here the reflex's way back to the task."""
    ticks: list[Tick] = []
    upper = Script([[]] * 100 + [[position(LEFT, 0.4)]], [[]] * 100 + [[LEFT]] * 180)  # until 0.56 s

    def hold() -> Reason | None:
        now = ticks[-1].now if ticks else 0.0
        return Reason(Code.OTHER, "a person holds it") if 0.5 < now < 0.62 else None

    with SimulatedDriver(load_robot("nao")) as driver:
        result = run(driver, Arbiter([upper, Turn()]), duration=1.0, observe=ticks.append, guard=hold)
    switched = [tick for tick in ticks if (LEFT, "velocity") in map(short, tick.commands)]
    assert any(tick.sent.state is GateState.HOLD for tick in switched)
    assert result.refusals
    assert not [tick for tick in ticks if tick.now > 0.7 and tick.sent.refusals]
    moved = [tick.reading.joints.position for tick in ticks if tick.now > 0.7]
    elbow = [servo.name for servo in load_robot("nao").servos].index("LElbowRoll")
    assert np.ptp([one[elbow] for one in moved]) > np.deg2rad(2.0), "the task moves the arm again"


def test_a_lasting_touch_keeps_its_part_and_frees_the_others() -> None:
    layers = Arbiter([tci.WithdrawalReflex(), Turn()])
    ticks, _, memory = touched("nao", layers, 1.5)
    assert memory.layers[0].claims == ({LEFT} if ticks[-1].perception.contacts else set())
    seen = [tick for tick in ticks if tick.perception.contacts]
    driven = [{one[0] for one in map(short, tick.commands) if one[1:2] == ("velocity",)} for tick in seen]
    assert len(driven) > 20
    assert all(parts == {RIGHT} for parts in driven)


def gesture(name: str) -> PlayGesture:
    times = np.linspace(0.0, 1.0, 21)
    swing = np.outer(np.sin(np.pi * times), [0.25, 0.0, 0.0, 0.25, 0.0])
    middle = np.deg2rad([25.0, 25.0, 0.0, 60.0, 0.0])
    arms = {LEFT: middle + swing, RIGHT: middle - 0.5 * swing}
    return PlayGesture(fit(load_robot(name), Gesture(times, arms)))


def test_an_interrupted_gesture_goes_on_where_it_paused_and_again_bit_for_bit() -> None:
    layers = Arbiter([tci.WithdrawalReflex(refractory=0.15), gesture("nao")])
    ticks, _, memory = touched("nao", layers, 2.6, retire=0.42)
    again, _, _ = touched("nao", layers, 2.6, retire=0.42)
    for one, other in zip(ticks, again, strict=True):
        assert [short(order) for order in one.commands] == [short(order) for order in other.commands]
        assert one.sent.position.tobytes() == other.sent.position.tobytes()

    play_memory, phases = layers.init(GenericBody(load_robot("nao"))), []
    body = GenericBody(load_robot("nao"))
    for tick in ticks[1:] if ticks[0].commands and isinstance(ticks[0].commands[0], SwitchMode) else ticks:
        _, play_memory = layers.step(play_memory, tick.perception, body)
        phases.append((play_memory.layers[1].memory.phase, tick.perception, play_memory.layers[1].memory))
    names = [phase for phase, _, _ in phases]
    assert play_memory.layers[1].memory.interruptions == 1
    assert names[-1] is Phase.DONE
    paused = names.index(Phase.INTERRUPTED)
    resumed = next(n for n in range(paused, len(names)) if names[n] is Phase.PLAY)
    wanted = layers.layers[1].gesture.at(phases[paused - 1][2].time)  # type: ignore[attr-defined]
    for part, angles in wanted.items():
        error = np.abs(phases[resumed][1].posture[part] - angles).max()
        print(f"{part}: {np.rad2deg(error):.2f} degrees from where it paused")
        assert error <= np.deg2rad(1.0)
    assert memory.layers[1].memory.phase is Phase.DONE
