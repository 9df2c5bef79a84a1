"""The MP4 film has a format that common players support, the correct length, and the correct pictures."""

from __future__ import annotations

import sys
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from tci.cli.main import app
from tci.errors import MissingExtraError
from tci.lab.pictures.film import Film
from tci.lab.pictures.video import save_video
from tci.robot.catalogue import load_robot
from tci.simulation.world import World


def decoded(path: Path) -> tuple[av.VideoCodecContext, list[np.ndarray]]:
    with av.open(str(path)) as file:
        (stream,) = file.streams.video
        return stream.codec_context, [frame.to_ndarray(format="rgb24") for frame in file.decode(stream)]


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    pictures = [Image.new("RGB", (64, 48), colour) for colour in ("#204060", "#a03010", "#10a040")]
    save_video(tmp_path / "a.mp4", pictures, shown=0.06, last=0.6)
    context, frames = decoded(tmp_path / "a.mp4")
    assert (context.name, context.pix_fmt) == ("h264", "yuv420p")
    assert len(frames) == 2 + 10
    for frame, picture in zip([*frames[:3], frames[-1]], [*pictures, pictures[-1]], strict=True):
        assert np.abs(frame.astype(int) - np.asarray(picture, dtype=int)).max() < 8


def test_a_run_is_filmed(tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    words = f"run withdrawal nao --duration 0.03 --film {path}".split()
    assert CliRunner().invoke(app, words).exit_code == 0
    _, frames = decoded(path)
    assert len(frames) == 1 + 17
    assert frames[0].shape == (480, 440, 3)
    assert frames[0].std() > 20.0


def test_without_the_library_it_is_told_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"a film as MP4 needs av, .*\[video\]"):
        Film(World(load_robot("nao"), skin=False), tmp_path / "a.mp4", fields=(), part="left_arm")
