"""iCub's conventions for contacts, checked with a contact list from the skinManager of an iCub."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.made_recordings import HELD, TOUCHED, TOUCHES
from helpers.skin_data import SkinData
from tci.errors import FrameError
from tci.recording.skin_manager import (
    NEIGHBOUR,
    SKIN_PARTS,
    SkinContact,
    contact_force,
    partition,
    read_skin_events,
)
from tci.robot.skin_files.file import read_skin_file
from tci.robot.skin_files.layout import SkinLayout

FILES = {
    "left_hand": "left_hand_V2_1",
    "left_forearm": "left_forearm_mesh",
    "right_hand": "right_hand_V2_1",
    "right_forearm": "right_forearm_mesh",
    "right_arm": "right_arm_mesh",
}
"""Position file for each part of the recorded robot."""
LINE = (
    "14739 1412842922.723273 ((1848 4 2 6) (0.06 -0.029 0.009) (-0.4 0.0 0.0) (0 0 0) (0 0 0) (1 0 0) "
    "(47) 9.3)"
)


@pytest.fixture(scope="module")
def recorded(skin_data: SkinData) -> dict[str, list[list[SkinContact]]]:
    """Returns the contacts of each part, frame by frame."""
    parts: dict[str, list[list[SkinContact]]] = defaultdict(list)
    for _, contacts in read_skin_events(skin_data.file("recordings/icub_skin_events.log")):
        frame: dict[str, list[SkinContact]] = defaultdict(list)
        for contact in contacts:
            frame[SKIN_PARTS[contact.skin_part]].append(contact)
        for part, found in frame.items():
            parts[part].append(found)
    return parts


def skin_of(data: SkinData, part: str) -> SkinLayout:
    return read_skin_file(data.file(f"icub/positions/{FILES[part]}.txt"))


@pytest.mark.parametrize("part", FILES)
def test_geometric_centres_partitions_and_forces(
    part: str, recorded: dict[str, list[list[SkinContact]]], skin_data: SkinData
) -> None:
    positions = skin_of(skin_data, part).positions
    centres, forces, same = [], [], []
    for contacts in recorded[part]:
        for contact in contacts:
            centre = positions[contact.taxels].mean(axis=0)
            centres.append(1e3 * np.linalg.norm(centre - contact.geometric_centre))
            force = contact_force(contact.taxels.size, contact.pressure, contact.normal)
            size = max(1.0, float(np.linalg.norm(contact.force)))
            forces.append(np.abs(force - contact.force).max() / size)
        active = np.concatenate([contact.taxels for contact in contacts])
        ours = {tuple(cluster.tolist()) for cluster in partition(positions, active)}
        same.append(ours == {tuple(sorted(contact.taxels.tolist())) for contact in contacts})
    exact = np.mean(np.array(centres) <= 0.01)
    p95 = np.percentile(centres, 95)
    row = (part, FILES[part], len(centres), f"{np.median(centres):.4f}", f"{p95:.4f}", f"{100 * exact:.1f}")
    print("|", " | ".join(map(str, row)), f"| {sum(same)} of {len(same)} | {max(forces):.0e} |")
    assert exact >= (0.98 if part == "left_hand" else 1.0)
    assert np.percentile(centres, 95) <= 0.01
    assert np.mean(same) >= 0.999
    assert max(forces) <= 1e-6


def test_the_recording_is_read_whole(
    recorded: dict[str, list[list[SkinContact]]], skin_data: SkinData
) -> None:
    counts = {part: sum(len(frame) for frame in frames) for part, frames in recorded.items()}
    genuine = {
        "left_hand": 381, "left_forearm": 1045, "right_hand": 277, "right_forearm": 924, "right_arm": 8,
        "torso": 127,
    }  # fmt: skip
    made = dict.fromkeys(TOUCHED, TOUCHES * 3 // 2 * HELD)
    assert counts == skin_data.expect(made=made, genuine=genuine)


def test_a_line_is_read(tmp_path: Path) -> None:
    log = tmp_path / "events.log"
    log.write_text(f"1 2.5 \n{LINE}\n")
    (first, none), (stamp, (contact,)) = read_skin_events(log)
    assert (first, none, stamp) == (2.5, (), 1412842922.723273)
    assert (contact.id, contact.body_part, contact.link, contact.skin_part) == (1848, 4, 2, 6)
    assert contact.taxels.tolist() == [47]
    assert contact.pressure == 9.3


@pytest.mark.parametrize(
    "damaged",
    [
        LINE.replace("(47)", "47"),
        LINE.replace("(1 0 0)", "(1 0)"),
        LINE.replace("(47)", "(-3)"),
        LINE.replace("(47)", "(99999999999999999999)"),
        LINE.replace(" 1412842922.723273", " nan"),
        LINE.replace(" 6)", " 77)"),
        LINE[:60],
        LINE.replace("9.3", "abc"),
        LINE.replace("9.3", "nan"),
        LINE.replace("-0.4", "inf"),
        "(" * 100,
        "word",
        LINE.replace("14739", "((((((((((14739))))))))))"),
        LINE.replace("0.06", "\u0660.06"),
    ],
)
def test_damaged_lines_are_one_error_with_the_line(tmp_path: Path, damaged: str) -> None:
    log = tmp_path / "events.log"
    log.write_text(f"{LINE}\n{damaged}\n")
    with pytest.raises(FrameError, match=r"line 2: .*valid:"):
        list(read_skin_events(log))


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_a_partition_is_single_link(seed: int, count: int) -> None:
    """In single-link clustering, two taxels belong to one contact if a chain of short steps connects them."""
    random = np.random.default_rng(seed)
    positions = random.uniform(0.0, 0.06, (count, 3))
    together = np.linalg.norm(positions[:, None] - positions[None], axis=2) <= NEIGHBOUR
    for _ in range(count):
        together = (together.astype(int) @ together.astype(int)) > 0
    expected = {tuple(np.flatnonzero(row).tolist()) for row in together}
    assert {tuple(c.tolist()) for c in partition(positions, np.arange(count))} == expected
