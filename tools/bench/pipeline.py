"""Benchmark from raw frames to a safe command, with the public classes GenericBody, WithdrawalReflex and
Gate."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from frame import Frame, InC
from measured import ROUNDS, Measured, cold, in_turn, row

import tci
from tci.gate import Gate
from tci.lab.authoring.dense_skin import with_dense_skin
from tci.messages import Command, GenericCommand, JointReading, Mode, Perception, Reading, SkinFrame
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.skin.conditioning import Conditioner
from tci.skin.layout import SkinLayout
from tci.skin.send_on_delta import HoldLast

PERIOD = 0.002
TURN = 40
"""Number of frames between two targets at opposite ends of the swing. The arm can't reach a target in so few
frames, so it always moves."""
SWING = np.deg2rad([15.0, 10.0, 15.0, 15.0, 15.0])
AWAY = np.array([0.0, 0.3, 0.0, 0.3, 0.0])
"""Offset (5,) [rad] from the initial posture to the middle of the swing. There the arm does not touch the
body."""
RARE = 200
"""Number of frames between two commands, for the row with rare commands."""
FACES = 0.5
"""Least cosine of the angle between a skin normal and a direction at which the skin counts as facing this
direction."""
BELOW = (0.0, 0.0, -1.0)
"""Direction of the touches to which both arms respond. The reflex refuses to respond to touches from all
sides, and checks this in each frame."""
WARM = 1000
"""Number of frames after which the reflex no longer moves the arm."""
STILL = 1e-6
"""Speed [rad/s] that counts as rest."""
SEEN = 60
"""Number of measured frames with a new command in a round."""


def touched(
    robot: Robot, contacts: int, *, dtype: type = np.uint8, towards: Sequence[float] | None = None
) -> list[dict[str, np.ndarray]]:
    """Returns two frames of all patches with a number of `contacts`, to be sent alternately.

    Larger patches have more contacts. The contacts of a patch are as far apart as possible. Touched taxels
    differ by one count between the frames. With `towards`, a direction (3,) in the torso frame, only skin
    that faces it in the initial posture is touched.
    """
    skin = tci.GenericBody(robot).skin
    surfaces, posture = skin.surfaces, np.array(initial_position(robot))
    poses = skin.kinematics.poses(posture, [patch.link for patch in robot.patches])
    touches = dict.fromkeys(surfaces, 0)
    for _ in range(contacts):
        touches[max(surfaces, key=lambda name: len(surfaces[name].positions) / (touches[name] + 1))] += 1
    frames: list[dict[str, np.ndarray]] = [{}, {}]
    for patch in robot.patches:
        surface, values = surfaces[patch.name], np.full(patch.channels, patch.sensor.rest, dtype)
        pitch, apart = float(np.sqrt(surface.areas.mean())), np.full(len(surface.positions), np.inf)
        if towards is not None:
            facing = surface.normals @ poses[patch.link][:3, :3].T @ np.array(towards)
            apart[facing < FACES] = 0.0
        for _ in range(touches[patch.name]):
            middle = surface.positions[int(apart.argmax())]
            distance = np.linalg.norm(surface.positions - middle, axis=1)
            values[surface.channels[distance < 1.6 * pitch]] = 120
            apart = np.minimum(apart, distance)
        for less, frame in enumerate(frames):
            frame[patch.name] = values - (values < 200).astype(dtype) * dtype(less)
    return frames


Memory = tuple[int, Any]


class Swinging(tci.Capability[Memory]):
    """Withdrawal reflex with an additional command every few frames, which swings the left arm between two
    targets."""

    def __init__(self, robot: Robot, every: int) -> None:
        self.reflex, self.every = tci.WithdrawalReflex(), every
        middle = np.array(robot.part("left_arm").initial_posture) + AWAY
        # Computed in advance, because this time is no part of TCI's time.
        self._targets = [middle + SWING * np.cos(np.pi * k / TURN) for k in range(2 * TURN)]

    def init(self, body: tci.GenericBody) -> Memory:
        return 0, self.reflex.init(body)

    def step(
        self, memory: Memory, perception: Perception, body: tci.GenericBody
    ) -> tuple[tuple[Command, ...], Memory]:
        count, own = memory[0] + 1, memory[1]
        commands, own = self.reflex.step(own, perception, body)
        if self.every and count % self.every == 0:
            target = self._targets[count % (2 * TURN)]
            commands = (*commands, GenericCommand("left_arm", Mode.POSITION, target))
        return commands, (count, own)


class Pipeline:
    """A touched robot. Every call processes the next frame of all patches.

    The reflex receives every frame. The arm soon stops moving, unless `every` is above 0: then a new command
    follows after each `every` frames.
    """

    def __init__(
        self, taxels: int, patches: int, contacts: int, *, every: int = 0, dtype: type = np.uint8,
        towards: Sequence[float] | None = BELOW,
    ) -> None:  # fmt: skip
        self.robot = with_dense_skin(tci.load_robot("icub"), max(taxels, 9 * patches), patches=patches)
        self.body = tci.GenericBody(self.robot)
        self.perceiver = tci.Perceiver(self.body)
        self.gate = Gate(self.robot, period=PERIOD, stale_after=0.1)
        self.capability = Swinging(self.robot, every)
        self.memory = self.capability.init(self.body)
        self.frames = touched(self.robot, contacts, dtype=dtype, towards=towards)
        self.position = np.array(initial_position(self.robot))
        self.every, self.count = every, 0
        self.taxels = sum(patch.channels for patch in self.robot.patches)
        for _ in range(WARM):
            self()
        moved = 0.0
        for _ in range(RARE):
            self()
            moved += bool(np.any(np.abs(self.sent.velocity) > STILL)) / RARE
        assert moved > 0.9 if 0 < every <= TURN else every or not moved, moved
        self.contacts = len(self.seen.contacts)

    def __call__(self) -> object:
        self.count = k = self.count + 1
        now = PERIOD * k
        joints = JointReading(now, k, self.position.copy(), np.zeros(len(self.position)))
        skin = tuple(SkinFrame(name, now, k, values) for name, values in self.frames[k % 2].items())
        self.seen = self.perceiver.step(Reading(joints, skin), now)
        commands, self.memory = self.capability.step(self.memory, self.seen, self.body)
        platform, refused = self.body.to_platform(commands, joints)
        safe = self.sent = self.gate.step(platform, joints, now, refused=refused)
        self.position[safe.servos] = safe.position
        return safe

    def rare(self) -> float:
        """Returns the median time [us] of the frames that have a new command."""
        times = []
        while len(times) < SEEN:
            timed = (self.count + 1) % self.every == 0
            begin = time.thread_time()
            self()
            if timed:
                times.append(time.thread_time() - begin)
        return 1e6 * statistics.median(times)


STATES = {"at rest": (0, 100.0), "moving": (TURN, 110.0), "a new command in each frame": (1, 130.0)}
"""Number of frames between two commands, and the target [us], by state."""


def pipeline() -> list[Measured]:
    rows: list[Measured] = []
    robot_of = partial(Pipeline, 4000, 16, 30)
    for state, (every, most) in STATES.items():
        ours, other = robot_of(every=every), robot_of(every=every, dtype=np.float64)
        peer = InC(Frame(ours.taxels, 5, ours.contacts))
        name = f"frame to safe command, {ours.taxels} taxels, {ours.contacts} contacts, {state}"
        colds = cold(ours), cold(peer)
        rows.append(row(name, "C program, without gate", in_turn(ours, peer), most=most, colds=colds))
        pairs = in_turn(other, ours)
        rows.append(row(f"{name}, frames of float64", "TCI with frames of uint8", pairs, most_ratio=1.3))
    seldom = robot_of(every=RARE)
    pairs = [(seldom.rare(), 120.0) for _ in range(ROUNDS)]
    name = f"frame to safe command, period with a new command (one in {RARE} periods)"
    rows.append(row(name, "none: the target", pairs, most=120.0))
    around, below = robot_of(towards=None), robot_of()
    name = f"frame to safe command, {around.contacts} contacts on all sides, checked in each frame"
    return [*rows, row(name, "TCI with contacts from below", in_turn(around, below))]


SIZES = ((230, 4, 1), (4000, 16, 0), (100_000, 16, 30), (1_000_000, 16, 30))
"""Numbers of taxels, patches and touches. On a skin with few taxels one touch may become several contacts."""


def scale(sizes: Sequence[tuple[int, int, int]] = SIZES) -> list[Measured]:
    """Times the pipeline for skins from 230 to 1 million taxels, while the arm moves."""
    rows = []
    for taxels, patches, contacts in sizes:
        ours = Pipeline(taxels, patches, contacts, every=TURN)
        peer = InC(Frame(ours.taxels, 5, contacts))
        name = f"frame to safe command, {ours.taxels} taxels, {ours.contacts} contacts, moving"
        rows.append(row(name, "C program, without gate", in_turn(ours, peer)))
    return rows


def events() -> list[Measured]:
    """Times the processing of untouched skin: frames sent on change (send-on-delta), and one frame per period
    for comparison."""
    robot = with_dense_skin(tci.load_robot("icub"), 4000, patches=16)
    raw = {p.name: np.full(p.channels, p.sensor.rest, np.uint8) for p in robot.patches}
    for values in raw.values():
        values.setflags(write=False)
    period = 1.0 / robot.patches[0].rate
    layout = SkinLayout.of_robot(robot)
    clocked, eventful = Conditioner(layout), Conditioner(layout)
    filled = HoldLast(robot, 1.0)
    count = [itertools.count(1), itertools.count(1)]
    sent: tuple[SkinFrame, ...] = ()

    def ours() -> object:
        nonlocal sent
        k = next(count[0])
        # sends one frame in 50 to show that the connection is alive; otherwise no frame would be sent
        if k % 50 == 1:
            sent = tuple(SkinFrame(name, period * k, k, values) for name, values in raw.items())
        return eventful.step(filled.fill(sent, period * k))

    def peer() -> object:
        k = next(count[1])
        frames = tuple(SkinFrame(name, period * k, k, values.copy()) for name, values in raw.items())
        return clocked.step(frames)

    pairs = in_turn(ours, peer)
    return [
        row(
            "conditioning of 16 untouched patches, frames sent on change",
            "TCI with all frames sent",
            pairs,
            most_ratio=1.0,
        )
    ]
