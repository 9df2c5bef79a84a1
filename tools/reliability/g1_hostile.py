"""Sends hostile commands to a G1 and judges the bytes that TCI sends. For some of the attacks, also judges
the bytes that a robot program of the vendor's SDK received over DDS."""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from g1 import ended, vendor_program
from pool import Job, Result, gather
from row import Row

from helpers.hostile_commands import SAG, WIGGLE, Attack
from tci.gate.partial_gate import PartialGate
from tci.messages import CONTROL_MODES, JointReading
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.collisions import solid_spec
from tci.robot.description import Robot as Description
from tci.shared.interface_node import InterfaceNode, Out
from tci.wires.unitree import messages
from tci.wires.unitree.driver import slots_of
from tci.wires.unitree.handover import TAKE, Phase
from tci.wires.unitree.keeper import DISCOVERY, FOLLOW, FOLLOWS, TAKES, Keeper, Orders
from tci.wires.unitree.keeper import TAKE as ASK
from tci.wires.unitree.set_points import SetPoints
from tci.wires.unitree.wire import HEAD, STATE, WEIGHT, encode_state

PERIOD = 0.004
CHUNK = 10_000
"""Number of commands of one attack."""
GAINS = 60.0, 1.5
"""Largest stiffness and damping over rt/arm_sdk, as in the vendor's example."""
ROUNDING = 1e-6
"""Relative rounding error of 32-bit numbers in messages, with a margin."""


DOMAIN = 118
"""DDS domain of the vendor's robot program."""
ANSWER = 0.2
"""Longest time [s] to wait for the receipt of one message. A message that arrives later still counts."""
PATIENCE = 30.0
"""Longest time [s] until the vendor's robot program is connected."""


def unitree_hostile(full: bool) -> Row:
    """Sends hostile commands in every mode and checks the bytes for rt/arm_sdk. One of 25 attacks is sent to
    the vendor's SDK."""
    done = gather("unitree_hostile", _attack, _jobs(96 if full else 1), full=full)
    done += gather("unitree_hostile_sdk", _sent, _jobs(4 if full else 1), full=full, alone=True)
    keys = "heard", "commands", "refused", "received"
    heard, commands, refused, received = (sum(one.get(key, 0) for one in done) for key in keys)
    faults = [fault for one in done for fault in one["faults"]]
    first = f" (the first: {faults[0]})" if faults else ""
    return Row(
        "hostile commands to a G1, judged by the messages that TCI sends to it",
        commands,
        1e6,
        "commands",
        f"{refused} commands refused; {len(faults)} of {heard} messages with a fault{first}; the vendor's "
        f"SDK received {received} of the messages over DDS",
        "0 messages outside the limits of position, speed, torque, gains and weight",
        bool(heard and received) and not faults,
    )


def _jobs(count: int) -> list[Job]:
    return [(seed,) for seed in range(count)]


class _Wire:
    """Replaces the DDS node of the keeper: always offers a fresh state, and records the bytes that are
    sent."""

    def __init__(self, sdk: _Sdk | None) -> None:
        self.sent: list[bytes] = []
        self.state = b""
        self._sdk = sdk

    def reader(self, topic: str, kind: Any, **options: Any) -> Any:
        wire = self

        class Reader:
            def take(self, most: int) -> list[Any]:
                if topic != "rt/lowstate":
                    return []
                sample = kind.__new__(kind)
                sample.raw = wire.state
                return [sample]

        return Reader()

    def out(self, topic: str, kind: Any) -> Any:
        return self._send

    def _send(self, data: bytes) -> None:
        self.sent.append(data)
        if self._sdk is not None:
            self._sdk.send(data)

    def fault_of_writers(self, topic: str, *, heard: bool = False) -> str:
        return ""


class _Sdk:
    """A robot program of the vendor's SDK in Python. The next message is sent after the program has received
    the previous one."""

    def __init__(self, log: Path) -> None:
        self._log, self._process = log, vendor_program("py_log", DOMAIN, str(log))
        assert self._process.stdout is not None
        self._dots = self._process.stdout.fileno()
        self._node = InterfaceNode("lo", DOMAIN)
        writer = self._node.writer("rt/arm_sdk", messages.COMMAND)
        self._out = Out(writer, messages.COMMAND)
        self._sent: list[bytes] = []
        end = time.monotonic() + PATIENCE
        while not writer.get_matched_subscriptions():
            assert time.monotonic() < end, "the vendor's robot does not connect"
            time.sleep(0.01)

    def send(self, data: bytes) -> None:
        self._sent.append(data)
        self._out(data)
        if select.select([self._dots], [], [], ANSWER)[0]:
            os.read(self._dots, 4096)

    def received(self) -> tuple[int, list[str]]:
        """Ends the robot program. Returns the number of messages that the program received, and the faults of
        these messages."""
        wrong = ended(self._process)["wrong"]
        self._node.close()
        log, size = self._log.read_bytes(), Robot.STRUCT
        structs = [log[at : at + size] for at in range(0, len(log), size)]
        # The message format lacks some padding bytes of the vendor's struct.
        found = [b"".join((HEAD, one[:2], one[4:6], one[8:])) for one in structs]
        sent = iter(self._sent)
        faults = [f"{wrong} with a wrong checksum"] if wrong else []
        return len(found), faults + ["received another than was sent" for one in found if one not in sent]


class Robot:
    """Independent check of the bytes that a robot receives. Shares no code with the driver.

    Positions must lie inside the limits. If a joint was measured outside its limits, its set-point must start
    from rest at the measured position and move only inward. Such a set-point may lie no farther outside than
    the joint was pushed while it had no stiffness, or sags while it has stiffness. From one message to the
    next, a set-point must move no faster than the joint's speed limit, or must equal the measured position.
    Beside stiffness, a torque must be what MuJoCo says that the set-points ask for.
    """

    MOTORS = struct.Struct("<" + "B3x5fI" * 35)
    STRUCT = 1004
    """Size [bytes] of the vendor's struct of a command."""

    def __init__(self, robot: Description, slots: list[int]) -> None:
        limits = [servo.limits for servo in robot.servos]
        self.model = solid_spec(robot).compile()
        self.data, self.inertia = mujoco.MjData(self.model), np.zeros((self.model.nv,) * 2)
        joints = [servo.joint for slot, servo in zip(slots, robot.servos, strict=True) if slot >= 12]
        self.dofs = np.array([self.model.joint(joint).dofadr[0] for joint in joints])
        self.slots = [slot for slot in slots if slot >= 12]
        mine = [limit for slot, limit in zip(slots, limits, strict=True) if slot >= 12]
        self.lower, self.upper, self.speed, self.rise, self.jerk, self.torque = (
            np.array([getattr(limit, name) for limit in mine], dtype=float)
            for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque")
        )
        self.beyond, self.least = np.zeros((2, len(mine)))
        self.before: Array | None = None
        self.speeds, self.loose = np.full(len(mine), np.nan), np.ones(len(mine), dtype=bool)
        self.judged = 0
        """Number of messages whose torques beside stiffness were judged."""
        self.faults: list[str] = []

    def see(self, data: bytes, measured: Array) -> None:
        """Checks one message. `measured` (k,) [rad] are the joint positions of the previous state message."""
        motors = np.array(self.MOTORS.unpack_from(data, 4)).reshape(35, 7)[:, :6]
        motors[0, 0] = data[6]  # byte of the message's header that the first motor shares
        mode, q, dq, tau, kp, kd = motors[self.slots].T
        close = ROUNDING * (1.0 + np.abs(q))
        moved = np.abs(q - (q if self.before is None else self.before))
        near = np.minimum(moved, np.abs(q - measured))
        loose = kp == 0.0
        found, outside = self._outside(measured), self._outside(q)
        self.beyond = np.where(loose, np.maximum(self.beyond, found), self.beyond)
        starts = loose | (np.abs(q - measured) <= self.jerk * PERIOD**3 + close)
        least = np.where(starts, np.maximum(found, self.least), self.least)
        self.least = np.minimum(least, outside)
        checks = {
            "not finite": ~np.isfinite(motors[self.slots]).all(axis=1),
            "not enabled": mode != 1,
            "position": outside > self.beyond + SAG + WIGGLE + close,
            "outward": outside > least + np.where(least > 0.0, WIGGLE, 0.0) + close,
            "jump": (near > self.speed * PERIOD * (1.0 + ROUNDING) + close) & ~loose,
            "speed": np.abs(dq) > self.speed * (1.0 + ROUNDING),
            "torque": np.abs(tau) > self.torque * (1.0 + ROUNDING),
            "torque beside stiffness": ~loose & self._wrong(q, dq, tau, loose),
            "gains": ~((kp >= 0.0) & (kp <= GAINS[0]) & (kd >= 0.0) & (kd <= GAINS[1])),
        }
        self.faults += [
            f"{name} of motor {self.slots[int(np.argmax(bad))]}" for name, bad in checks.items() if bad.any()
        ]
        if not 0.0 <= motors[WEIGHT, 1] <= 1.0:
            self.faults.append(f"weight {motors[WEIGHT, 1]}")
        if motors[:12, 0].any():
            self.faults.append("a leg is enabled")
        self.before = q

    def _wrong(self, q: Array, dq: Array, tau: Array, loose: Array) -> Array:
        """Which torques (k,) aren't those of the motion, by more than a period's jerk explains. Nothing is
        known of a motion that begins anew at some speed, as where a motor gets stiffness."""
        rates, self.speeds = (dq - self.speeds) / PERIOD, dq
        anew, self.loose = loose != self.loose, loose
        if anew.any() or not (np.abs(rates) <= self.rise + self.jerk * PERIOD).all():
            return np.zeros(len(q), dtype=bool)
        self.judged += 1
        model, data, dofs = self.model, self.data, self.dofs
        data.qpos[model.jnt_qposadr[dofs]], data.qvel[dofs] = q, dq
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, self.inertia)
        inertia = self.inertia[np.ix_(dofs, dofs)]
        asked = np.clip(data.qfrc_bias[dofs] + inertia @ rates, -self.torque, self.torque)
        found: Array = np.abs(tau - asked) > np.abs(inertia) @ (self.jerk * PERIOD) + 0.01 * self.torque
        return found

    def _outside(self, position: Array) -> Array:
        """Returns the distance (k,) [rad] of joints at `position` (k,) [rad] outside their limits."""
        beyond: Array = np.maximum(np.maximum(position - self.upper, self.lower - position), 0.0)
        return beyond


class _Attack(Attack):
    """An attack on the gate of a G1's driver. The gate's output is encoded as bytes for the robot."""

    eager = 0.7
    cycle = 1100
    """Number of steps from one rest to the next, which is twice that of other attacks."""

    def __init__(self, seed: int, sdk: _Sdk | None = None) -> None:
        robot = load_robot("g1")
        servos = tuple(s.model_copy(update={"modes": CONTROL_MODES}) for s in robot.servos)
        robot = robot.model_copy(update={"servos": servos})
        super().__init__(robot, seed, period=PERIOD, body=False)
        self.slots = slots_of(robot)
        self.servos = np.flatnonzero(self.slots >= 12)
        self.movable = [*self.servos.tolist(), int(np.argmin(self.slots))]  # the last servo is refused
        legs = {servo: "a leg" for servo, slot in enumerate(self.slots.tolist()) if slot < 12}
        # In an attack, links pass through each other. The check for self-collision would hold the arms in
        # such postures, which no real robot can reach.
        self.gate = PartialGate(robot, legs, period=PERIOD, stale_after=0.1, streams=True)
        self.wire, self.set_points = _Wire(sdk), SetPoints(robot, self.slots, whole=False)
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        theirs.setblocking(False)
        orders = Orders("lo", 0, "rt/arm_sdk", whole=False, simulation=False, period=PERIOD, socket=0)
        self.keeper = Keeper(orders, self.wire, theirs)
        self.end = Robot(robot, self.slots.tolist())
        self.messages, self.refused, self.time = 0, 0, 0.0
        self.socket.send(TAKES.pack(ASK, *self.set_points.holds(self._true).tolist()))
        while self.keeper.handover.phase is not Phase.LEADING:
            self._tell(self.angles)
            assert self.time < 2.0 * (DISCOVERY + TAKE)

    def _pass(self, orders: Any, malformed: int, when: float, *, moved: bool = True) -> Any:
        seen = self.angles.copy()
        safe = super()._pass(orders, malformed, when, moved=moved)
        self.refused += len(safe.refusals)
        chosen, targets = self.set_points.of(safe, self._true)
        self.socket.send(FOLLOWS.pack(FOLLOW, *chosen.tolist(), targets.tobytes()))
        self._tell(seen)
        return safe

    @property
    def _true(self) -> JointReading:
        return JointReading(self.time, self.messages, self.angles, np.zeros(len(self.angles)))

    def _see(self, safe: Any, before: Array, speed: Array, moved: bool) -> None:
        self.judge.see(safe, before, moved=moved, speed=speed)  # predicted motions are not sent to a G1

    def _tell(self, seen: Array) -> None:
        """Runs the keeper for one period, and checks the bytes that the keeper sends. `seen` (n,) [rad] are
        the joint positions before this period."""
        self.time += PERIOD
        state: Any = np.zeros((), STATE)
        state["mode_machine"], state["quaternion"][0] = 5, 1.0
        state["motor"]["q"][self.slots] = self.angles
        self.wire.state = encode_state(state)
        self.keeper.step(self.time)
        measured = seen[self.servos]
        for data in self.wire.sent:
            self.messages += 1
            self.end.see(data, measured)
        self.wire.sent.clear()


def _attack(seed: int, sdk: _Sdk | None = None) -> Result:
    attack = _Attack(seed, sdk)
    while attack.counts.commands < CHUNK:
        attack.step()
    return {
        "heard": attack.messages, "commands": attack.counts.commands, "refused": attack.refused,
        "faults": attack.end.faults + attack.judge.faults,
    }  # fmt: skip


def _sent(seed: int) -> Result:
    """Attacks the vendor's robot program. Checks that each message that the program received equals, bit by
    bit, a message that was sent and judged."""
    with TemporaryDirectory() as folder:
        sdk = _Sdk(Path(folder) / "received")
        result = _attack(1000 + seed, sdk)
        received, faults = sdk.received()
    return {**result, "received": received, "faults": result["faults"] + faults}
