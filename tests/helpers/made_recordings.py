"""Recordings that are made for the tests, in the format of yarpdatadumper: raw values of a foot, and contact
lists."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from helpers.made_skins import PADS, SKINS, Array, Made, places

REST = 240
"""Raw value of an untouched taxel, and constant value of an absent module."""
FOOT_FRAMES = {"01": 400, "08": 350}
SILENT_MODULES = range(8, 12)
"""Modules whose board fails in recording 08. They always send REST."""

TOUCHES, HELD = 12, 5
"""Number of touches of each part in the contact lists, and number of frames per touch. Two fingers make every
second touch."""
EVENT_FRAMES = 400
FINGER = 0.008
"""Radius [m] of a fingertip."""
TOUCHED = {
    # For each part: position file, and the numbers of body part, link and skin part.
    "left_hand": ("left_hand_V2_1", 3, 6, 1),
    "left_forearm": ("left_forearm_mesh", 3, 4, 2),
    "right_hand": ("right_hand_V2_1", 4, 6, 4),
    "right_forearm": ("right_forearm_mesh", 4, 4, 5),
    "right_arm": ("right_arm_mesh", 4, 2, 6),
    "torso": ("torso", 1, 2, 7),
}


def write_recordings(folder: Path) -> None:
    folder.mkdir(parents=True)
    for number in FOOT_FRAMES:
        (folder / f"icub_right_foot_raw_{number}.log").write_text(foot_log(number))
    (folder / "icub_skin_events.log").write_text(contact_log())


def foot_log(number: str) -> str:
    """Returns the log of a sole over which a person's foot rolls while the values drift. Thermal pads respond
    only to warmth."""
    random, frames = np.random.default_rng(int(number)), FOOT_FRAMES[number]
    made = SKINS["icub/positions/left_foot"]
    positions, _ = places(made)
    present = np.isin(np.arange(made.channels) // 12, made.present())
    if number == "08":
        present &= ~np.isin(np.arange(made.channels) // 12, SILENT_MODULES)
    pads = present & np.isin(np.arange(made.channels) % 12, PADS)
    time = np.linspace(0.0, 1.0, frames)[:, None]
    pressed = np.abs(positions[:, 0] - 0.2 * np.abs(np.sin(2.0 * np.pi * time))) < 0.015
    values = np.full((frames, made.channels), REST)
    values[:, present] = random.integers(190, REST, present.sum()) - (4 * time).astype(int)
    values -= random.integers(0, 3, values.shape) * present
    values -= 90 * (pressed & present & ~pads)
    return "".join(
        f"{4898 + i} {1424362797.5 + 0.02 * i:.6f} {' '.join(f'{value:.1f}' for value in row)}\n"
        for i, row in enumerate(values)
    )


def contact_log() -> str:
    """Returns a log in the format of skinManager, in which one or two fingers touch each part in turn."""
    random = np.random.default_rng(1)
    lines: list[str] = [f"{14716 + i} {1412842922.0 + 0.02 * i:.6f}" for i in range(EVENT_FRAMES)]
    for touch in range(TOUCHES):
        for order, (part, (file, *numbers)) in enumerate(TOUCHED.items()):
            made = SKINS[f"icub/positions/{file}"]
            positions, normals = places(made, mirrored="right" in part)
            for finger, taxels in enumerate(_under_fingers(made, positions, 1 + touch % 2, random)):
                head = " ".join(map(str, [1000 + 10 * touch + finger, *numbers]))
                for frame in range(HELD):
                    period = (touch * len(TOUCHED) + order) * HELD + frame
                    lines[period] += " " + _contact(
                        head, taxels, positions, normals, random.uniform(15.0, 60.0)
                    )
    return " \n".join([*lines, ""])


def _under_fingers(
    made: Made, positions: Array, fingers: int, random: np.random.Generator
) -> list[NDArray[np.intp]]:
    taxels = np.flatnonzero(positions.any(axis=1) & ~np.isin(np.arange(made.channels) % 12, made.form.pads))
    first = positions[random.choice(taxels)]
    farthest = positions[taxels[np.argmax(np.linalg.norm(positions[taxels] - first, axis=1))]]
    at = (first, farthest)[:fingers]
    return [taxels[np.linalg.norm(positions[taxels] - place, axis=1) < FINGER] for place in at]


def _contact(head: str, taxels: NDArray[np.intp], positions: Array, normals: Array, pressure: float) -> str:
    """Returns a contact along the mean normal, with a force of -0.05 N per taxel and unit of pressure."""
    centre, normal = positions[taxels].mean(axis=0).round(6), normals[taxels].mean(axis=0).round(6)
    force = -0.05 * len(taxels) * round(pressure, 6) * normal
    vectors = (centre, force, np.zeros(3), centre, normal)
    lists = [f"({' '.join(f'{value:.6f}' for value in vector)})" for vector in vectors]
    return f"(({head}) {' '.join(lists)} ({' '.join(map(str, taxels))}) {pressure:.6f})"
