"""Raw frames to a safe command, through public parts only: Body, WithdrawalReflex, Gate."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np
from frame import Frame, InC
from measured import Measured, cold, in_turn, row

import tci
from tci.authoring.dense_skin import with_dense_skin
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.joint_map import initial_position
from tci.skin.send_on_delta import HoldLast

PERIOD = 0.002


class Pipeline:
    """A robot with so many taxels; every call is the next frame of all patches."""

    def __init__(self, taxels: int, patches: int, contacts: int) -> None:
        self.robot = with_dense_skin(tci.load_robot("icub"), max(taxels, 9 * patches), patches=patches)
        self.body = tci.GenericBody(self.robot)
        self.gate = tci.Gate(self.robot, period=PERIOD, stale_after=0.1)
        self.reflex = tci.WithdrawalReflex()
        self.memory = self.reflex.init()
        self.values = {}
        for number, patch in enumerate(self.robot.patches):
            surface = self.body.skin.surfaces[patch.name]
            values = np.full(patch.channels, patch.sensor.rest, np.uint8)
            pitch, apart = float(np.sqrt(surface.areas.mean())), np.full(len(surface.positions), np.inf)
            for _ in range(contacts // patches + (number < contacts % patches)):
                middle = surface.positions[int(apart.argmax())]
                distance = np.linalg.norm(surface.positions - middle, axis=1)
                values[surface.channels[distance < 1.6 * pitch]] = 120
                apart = np.minimum(apart, distance)
            self.values[patch.name] = values
        later = {name: values - (values < 200).astype(np.uint8) for name, values in self.values.items()}
        self.frames = (self.values, later)  # what is touched differs from frame to frame
        self.position = np.array(initial_position(self.robot))
        self.count = itertools.count(1)
        self.taxels = sum(patch.channels for patch in self.robot.patches)
        self()
        self.found = len(self.seen.contacts)

    def __call__(self) -> object:
        k = next(self.count)
        now = PERIOD * k
        joints = JointReading(now, k, self.position.copy(), np.zeros(len(self.position)))
        skin = tuple(SkinFrame(name, now, k, values) for name, values in self.frames[k % 2].items())
        self.seen = self.body.perceive(Reading(joints, skin), now)
        commands, self.memory = self.reflex.step(self.memory, self.seen)
        safe = self.gate.step(self.body.to_platform(commands, joints), joints, now)
        self.position[safe.servos] = safe.position
        return safe


SIZES = ((40, 4, 1), (230, 4, 1), (768, 4, 5), (4000, 16, 30), (4000, 16, 0), (100_000, 16, 30))
"""Taxels, patches and touches, as far from each other as can be; one where few taxels are is several."""


def pipeline(sizes: Sequence[tuple[int, int, int]] = SIZES) -> list[Measured]:
    rows = []
    for taxels, patches, contacts in sizes:
        ours = Pipeline(taxels, patches, contacts)
        peer = InC(Frame(ours.taxels, 5, contacts))
        rows.append(
            row(
                f"frame to safe command, {ours.taxels} taxels in {patches} patches, {ours.found} contacts",
                "C kernel, no gate",
                in_turn(ours, peer),
                most=100.0 if taxels == 4000 and ours.found >= 30 else None,
                colds=(cold(ours), cold(peer)),
            )
        )
    return rows


pipeline_1000000 = partial(pipeline, ((1_000_000, 16, 30),))


def events() -> list[Measured]:
    """The skin alone, all patches at rest: senders that send changes only, beside senders of every frame."""
    robot = with_dense_skin(tci.load_robot("icub"), 4000, patches=16)
    raw = {p.name: np.full(p.channels, p.sensor.rest, np.uint8) for p in robot.patches}
    for values in raw.values():
        values.setflags(write=False)
    joints = JointReading(0.0, 0, np.array(initial_position(robot)), np.zeros(len(robot.servos)))
    period = 1.0 / robot.patches[0].rate
    clocked, eventful = tci.Skin(robot), tci.Skin(robot)
    filled = HoldLast(robot, 1.0)
    count = [itertools.count(1), itertools.count(1)]
    sent: tuple[SkinFrame, ...] = ()

    def ours() -> object:
        nonlocal sent
        k = next(count[0])
        if k % 50 == 1:  # one keep-alive in 50 frames: else nothing is sent
            sent = tuple(SkinFrame(name, period * k, k, values) for name, values in raw.items())
        return eventful.update(Reading(joints, filled.fill(sent, period * k)))

    def peer() -> object:
        k = next(count[1])
        frames = tuple(SkinFrame(name, period * k, k, values.copy()) for name, values in raw.items())
        return clocked.update(Reading(joints, frames))

    pairs = in_turn(ours, peer)
    return [
        row("conditioning of 16 patches at rest, event-driven", "every frame sent", pairs, most_ratio=1.0)
    ]
