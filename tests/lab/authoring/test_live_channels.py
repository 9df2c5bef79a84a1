"""Taxels, pads and unused channels of a foot are identified from the recorded values alone."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.skin_data import SkinData
from tci.errors import TciError
from tci.lab.authoring.live_channels import live_channels
from tci.robot.skin_files.file import read_skin_file


def raw(data: SkinData, number: str) -> np.ndarray:
    rows = data.file(f"recordings/icub_right_foot_raw_{number}.log").read_text().splitlines()
    return np.array([row.split()[2:] for row in rows], dtype=float)


def agreement(data: SkinData, values: np.ndarray) -> float:
    skin = read_skin_file(data.file("icub/positions/right_foot.txt"))
    known = np.zeros(384, dtype=bool)
    known[skin.taxels] = True
    return float((live_channels(values) == known).mean())


def test_iCub_s_foot_is_told_from_its_pads_and_absent_places(skin_data: SkinData) -> None:
    one, other = raw(skin_data, "01"), raw(skin_data, "08")
    assert agreement(skin_data, one) >= 0.99
    assert agreement(skin_data, np.concatenate([one, other])) >= 0.99


def test_four_silent_modules_of_the_other_recording_are_all_that_is_missing(skin_data: SkinData) -> None:
    """In this recording the board of modules 8 to 11 always sends 240, so 40 taxels can't be identified."""
    values = raw(skin_data, "08")
    assert (values[:, 96:144] == 240.0).all()
    assert agreement(skin_data, values) == pytest.approx(1.0 - 40 / 384)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros((3, 13)), "multiple of 12"),
        (np.zeros((3, 24)), "nothing changes"),
        (np.full((3, 24), np.nan), "not finite"),
        (np.zeros((0, 24)), "multiple of 12"),
    ],
)
def test_frames_that_tell_nothing(values: np.ndarray, words: str) -> None:
    with pytest.raises(TciError, match=words):
        live_channels(values)
