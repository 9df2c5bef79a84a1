"""Streams of set-points into a served board: the gate keeps all limits for every stream."""

from __future__ import annotations

import os

import numpy as np

from helpers.gate_checks import Driven, make_robot, reading
from tci.gate.bounds import bounds_of
from tci.gate.trajectory import OnlineTrajectory
from tci.wires.yarp.served_board import ServedBoard
from yarpwire.board import DIRECT, Stream

PERIOD = 0.005


def test_whatever_streams_the_gate_keeps_its_limits() -> None:
    """Streams are steps, zigzags, noise, motions at the limits, repetitions, gaps and large numbers. `make
    soak` runs more cycles."""
    cycles = int(os.environ.get("TCI_SOAK", "6000"))
    random = np.random.default_rng(11)
    driven = Driven(make_robot(), [0.0] * 6)
    board = ServedBoard("arm", driven.robot.servos)
    board.set_modes(None, [DIRECT] * 6)
    bounds, _ = bounds_of(driven.robot, range(6), speed_share=1.0)
    sender, told, kind, every = OnlineTrajectory(bounds, np.zeros(6), PERIOD), np.zeros(6), 0, 3
    for cycle in range(cycles):
        if cycle % 150 == 0:
            kind, every = int(random.integers(6)), int(random.integers(1, 9))
            sender.aim(bounds.nearest(random.uniform(-3.0, 3.0, 6), np.ones(6, dtype=bool)), bounds.velocity)
        if cycle % every == 0 and random.random() < 0.95:
            told = sender.step() if kind in (0, 1) else told
            if kind == 1:
                told = told + random.normal(0.0, 1e-4, 6)
            elif kind > 1 and random.random() < 0.9:
                told = told + random.choice([1e-5, 1e-2, 1.0]) * random.normal(size=6)
            if kind == 5 and random.random() < 0.1:
                told = random.choice([-1.0, 1.0], 6) * 1e12
            group = [0, 3, 4] if kind == 4 else list(range(6))
            board.stream(Stream.POSITION, group, np.rad2deg(told[group]).tolist())
        if random.random() < 0.002:
            driven.gate.hold("for a test")
        safe = driven.step(*board.book.take())
        board.book.judge(safe.orders, safe.refusals)
        board.update(reading(driven.angles, driven.time), driven.gate.modes)
        if cycle % 5000 == 4999:
            driven.assert_within_limits()
            del driven.path[:-3]
    driven.assert_within_limits()
