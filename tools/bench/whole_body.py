"""Benchmark of an iCub's whole skin, from frames in float64 (the type that YARP sends) to contacts."""

from __future__ import annotations

import time

import numpy as np
from frame import Frame, InC
from measured import ROUNDS, Measured, each, in_turn, row
from pipeline import touched

import tci
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.joint_map import initial_position

RATE = 50.0
CONTACTS = 30
FRAMES = 400
"""Number of frames in a round."""


class Perceiving:
    """A perceiver. Every call processes the next frame of all patches: conditioning, kinematics, contacts and
    tracking."""

    def __init__(self, dtype: type) -> None:
        self.robot = tci.load_robot("icub-whole")
        self.perceiver = tci.Perceiver(tci.GenericBody(self.robot))
        self._frames = touched(self.robot, CONTACTS, dtype=dtype)
        self._position, self._count = np.array(initial_position(self.robot)), 0
        self.taxels = sum(patch.channels for patch in self.robot.patches)
        self()
        self.contacts = len(self.seen.contacts)

    def __call__(self) -> object:
        self._count = k = self._count + 1
        now = k / RATE
        joints = JointReading(now, k, self._position.copy(), np.zeros(len(self._position)))
        frames = self._frames[k % 2].items()
        skin = tuple(SkinFrame(name, now, k, values.copy()) for name, values in frames)
        self.seen = self.perceiver.step(Reading(joints, skin), now)
        return sum(contact.force for contact in self.seen.contacts)  # each is looked at

    def round(self) -> tuple[float, float]:
        """Returns the median and the 95th percentile of the time [us] of a frame."""
        times = []
        for _ in range(FRAMES):
            start = time.thread_time()
            self()
            times.append(time.thread_time() - start)
        median, p95 = 1e6 * np.quantile(times, [0.5, 0.95])
        return float(median), float(p95)


def whole_body() -> list[Measured]:
    ours, other = Perceiving(np.uint8), Perceiving(np.float64)
    peer = InC(Frame(ours.taxels, 5, CONTACTS))
    both = [(ours.round(), each(peer, calls=FRAMES)) for _ in range(ROUNDS)]
    name = f"whole iCub, {ours.taxels} taxels in {len(ours.robot.patches)} patches, "
    name += f"{ours.contacts} contacts: from frame to contacts"
    return [
        row(f"{name}, median", "C program", [(found[0], theirs) for found, theirs in both], most=250.0),
        row(
            f"{name}, 95th percentile",
            "C program",
            [(found[1], theirs) for found, theirs in both],
            most=350.0,
        ),
        row(f"{name}, frames of float64", "TCI with frames of uint8", in_turn(other, ours), most_ratio=1.3),
    ]
