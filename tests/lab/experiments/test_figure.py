"""The figure of the demo has the correct size and contains its panels, compared pixel by pixel."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from tci.errors import TciError
from tci.lab.experiments.figure import Panel, draw_figure
from tci.lab.pictures.paint import FieldLook
from tci.lab.pictures.render import background


def panel(colour: tuple[int, int, int], *, size: int = 200) -> Panel:
    return Panel(np.full((size, size, 3), colour, dtype=np.uint8), "NAO: forearm", "180 ms")


def test_panels_come_out_row_by_row(tmp_path: Path) -> None:
    colours = [(250, 0, 0), (0, 250, 0), (0, 0, 250), (250, 250, 0)]
    path = tmp_path / "figure.png"
    fields = [("flexor", FieldLook("forearm", 0.5, 0.0, 0.2, (0.1, 0.6, 0.9)))]
    draw_figure([panel(c) for c in colours], path, columns=2, fields=fields, full_scale=6e4, caption="Ours.")
    picture = np.round(255 * imread(path)[..., :3]).astype(int)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert picture.shape[1] == 2 * 200 + 3 * 8
    centres = {}
    for colour in colours:
        rows, columns = np.nonzero((picture == colour).all(axis=2))
        assert len(rows) > 0.96 * 200 * 200  # without the frame
        centres[colour] = rows.mean(), columns.mean()
    order = sorted(colours, key=lambda c: (round(centres[c][0]), centres[c][1]))
    assert order == colours


def test_a_close_up_lies_where_it_hides_least(tmp_path: Path) -> None:
    image = np.round(255 * np.repeat(background(200)[:, None], 200, axis=1)).astype(np.uint8)
    image[:150, :60] = image[:60, 140:] = 40  # both upper corners and the lower left one
    image[190:, :60] = 40
    close_up = np.full((50, 50, 3), (250, 0, 0), dtype=np.uint8)
    path = tmp_path / "figure.png"
    draw_figure(
        [Panel(image, "a", close_up=close_up, spot=(100, 100), arrow=((20, 20), (60, 90)))],
        path,
        columns=1,
        full_scale=6e4,
    )
    picture = np.round(255 * imread(path)[..., :3]).astype(int)
    rows, columns = np.nonzero((picture == (250, 0, 0)).all(axis=2))
    assert len(rows) > 0.85 * 50 * 50
    assert columns.mean() > 8 + 140
    assert rows.mean() > 54 + 140


def test_panels_must_fit_together(tmp_path: Path) -> None:
    with pytest.raises(TciError, match="one size"):
        draw_figure([panel((0, 0, 0)), panel((0, 0, 0), size=100)], tmp_path / "a.png", full_scale=1.0)
    with pytest.raises(TciError, match="one size"):
        draw_figure([], tmp_path / "a.png", full_scale=1.0)
    assert not (tmp_path / "a.png").exists()
