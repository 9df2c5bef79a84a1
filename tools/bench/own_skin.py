"""A whole iCub in its own skin: the files of a real one's taxels, through the public way to contacts."""

from __future__ import annotations

import itertools
import os
import time
from pathlib import Path

import numpy as np
from frame import Frame, InC
from measured import ROUNDS, Measured, each, row

import tci
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.description import Patch, Robot, Table
from tci.robot.joint_map import initial_position
from tci.robot.skin_files.reader import read_layout

DATA = Path(os.environ.get("DATA", ""), "icub", "positions_pycub")
"""Calibration files in the links' frames; they are not part of this repository (DATA=FOLDER)."""
FILES = {
    "upper_arm": "arm", "forearm": "forearm", "palm": "hand",
    "thigh": "leg_upper", "shank": "leg_lower", "sole": "foot",
}  # fmt: skip
RATE = 50.0
CONTACTS = 30
REACH = 0.012
"""Taxels this near [m] the middle of a touch feel it."""
FRAMES = 400
"""Frames in a round."""


def icub_in_its_skin() -> Robot:
    """`icub-whole` with the skins of a real one instead of ours: torso, arms, hands, legs, soles."""
    if not DATA.is_dir():
        raise SystemExit(f"needs the skins of a real iCub in {DATA}; valid: DATA=FOLDER make bench")
    robot = tci.load_robot("icub-whole")
    patches = []
    for patch in robot.patches:
        side, _, place = patch.name.partition("_")
        file = "torso.txt" if patch.name == "torso_skin" else f"{side}_{FILES.get(place)}.txt"
        if (DATA / file).is_file():
            patches.append(_from_file(patch, DATA / file))
    return robot.model_copy(update={"patches": tuple(patches)})


def _from_file(patch: Patch, file: Path) -> Patch:
    table = Table(file=str(file), format="icub")
    channels = len(read_layout(file).positions)
    return patch.model_copy(update={"surface": table, "channels": channels, "rate": RATE})


class Perceiving:
    """Every call is the next frame of all patches: conditioning, kinematics, contacts and who is who."""

    def __init__(self) -> None:
        self.robot = icub_in_its_skin()
        self.body = tci.GenericBody(self.robot)
        surfaces = self.body.skin.surfaces
        self.taxels = sum(len(surface.positions) for surface in surfaces.values())
        self._raw = (self._touched(120), self._touched(119))
        self._position = np.array(initial_position(self.robot))
        self._count = itertools.count()
        self._perceive(({name: np.full(v.shape, 240, v.dtype) for name, v in self._raw[0].items()},))
        self()
        self.contacts = len(self.seen.contacts)

    def _touched(self, value: int) -> dict[str, np.ndarray]:
        """Raw frames with touches on every patch, the more the larger it is, as far apart as they can be."""
        surfaces = self.body.skin.surfaces
        touches = dict.fromkeys(surfaces, 0)
        for _ in range(CONTACTS):
            emptiest = max(surfaces, key=lambda name: len(surfaces[name].positions) / (touches[name] + 1))
            touches[emptiest] += 1
        raw = {}
        for patch in self.robot.patches:
            surface = surfaces[patch.name]
            values = np.full(patch.channels, 240, np.uint8)
            apart = np.full(len(surface.positions), np.inf)
            for _ in range(touches[patch.name]):
                middle = surface.positions[int(np.argmax(apart))]
                distance = np.linalg.norm(surface.positions - middle, axis=1)
                values[surface.channels[distance < REACH]] = value
                apart = np.minimum(apart, distance)
            raw[patch.name] = values
        return raw

    def __call__(self) -> object:
        return self._perceive(self._raw)

    def _perceive(self, raw: tuple[dict[str, np.ndarray], ...]) -> object:
        k = next(self._count)
        now = k / RATE
        joints = JointReading(now, k, self._position.copy(), np.zeros(len(self._position)))
        skin = tuple(SkinFrame(name, now, k, values.copy()) for name, values in raw[k % len(raw)].items())
        self.seen = self.body.perceive(Reading(joints, skin), now)
        return sum(contact.force for contact in self.seen.contacts)  # each is looked at


def own_skin() -> list[Measured]:
    """The median and the slow end of single frames, on the wall's clock: a frame of 20 ms may be late too."""
    ours = Perceiving()
    peer = InC(Frame(ours.taxels, 5, CONTACTS))
    middle, slow = [], []
    for _ in range(ROUNDS):
        times = []
        for _ in range(FRAMES):
            start = time.perf_counter()
            ours()
            times.append(time.perf_counter() - start)
        theirs = each(peer, calls=FRAMES, clock=time.perf_counter)
        median, p95 = 1e6 * np.quantile(times, [0.5, 0.95])
        middle.append((float(median), theirs))
        slow.append((float(p95), theirs))
    name = f"whole iCub in its own skins, {ours.taxels} taxels in {len(ours.robot.patches)} patches, "
    name += f"{ours.contacts} contacts: frame to contacts"
    return [
        row(f"{name}, median", "C kernel", middle, most=500.0),
        row(f"{name}, p95", "C kernel", slow, most=500.0),
    ]
