"""The reader of CoST, on a small file with its columns: blows and strokes of three people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from helpers.command_line import tci as command
from tci.errors import DescriptionError
from tci.lab.words.cost import read_cost
from tci.lab.words.training import left_out


def made(path: Path, people: int = 3, each: int = 6) -> Path:
    random = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(8), np.arange(8), indexing="ij"), axis=-1)
    lines = ["subject, variant, gesture, frame, " + ", ".join(f"ch{k + 1}" for k in range(64))]
    for person in range(1, people + 1):
        for number in range(each):
            for gesture, seconds in ((13, 0.1), (12, 1.2)):
                count = round(135 * seconds * random.uniform(0.8, 1.3))
                start = random.uniform(1.0, 3.0, 2)
                for frame in range(count + 20):
                    share = (frame - 10) / count
                    at = start + (np.array([4.0 * share, 0.0]) if gesture == 12 else 0.0)
                    top = 500.0 if 0.0 <= share < 1.0 else 0.0
                    apart = ((grid - at) ** 2).sum(axis=-1).ravel()
                    counts = random.integers(0, 5, 64) + np.rint(top * np.exp(-apart))
                    row = [person, 1 + number % 3, gesture, frame, *counts.astype(int).tolist()]
                    lines.append(",".join(map(str, row)))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_blows_and_strokes_of_people_are_read_and_told_apart(tmp_path: Path) -> None:
    found = read_cost(made(tmp_path / "CoST.csv"))
    assert found.counts == {"tap": 18, "stroke": 18}
    assert set(found.groups) == {"person 1", "person 2", "person 3"}
    scores = left_out(found)
    assert set(scores) == set(found.groups)
    assert min(scores.values()) > 0.9


def test_one_command_leaves_each_person_out(tmp_path: Path) -> None:
    path = made(tmp_path / "CoST.csv", each=3)
    said = json.loads(command("words", "score", str(path), "--json"))
    assert said["touches"] == 18
    assert set(said["people"]) == {"person 1", "person 2", "person 3"}
    assert said["right"] == pytest.approx(np.mean(list(said["people"].values())))
    assert said["right"] > 0.9


def test_another_file_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("time,force\n0,1\n")
    with pytest.raises(DescriptionError, match=r"columns time, force .*valid: subject, variant, gesture"):
        read_cost(path)
    lines = made(tmp_path / "CoST.csv", people=1, each=1).read_text().splitlines()
    path.write_text("\n".join([*lines[:5], lines[5].replace(",13,", ",77,"), lines[6]]) + "\n")
    with pytest.raises(DescriptionError, match="gesture '77'; valid: 1 to 14"):
        read_cost(path)
