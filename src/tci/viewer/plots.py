"""Plots of the last seconds: force and response of all robots, joint angles of each."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from viser import uplot

from tci.frames import Array
from tci.model.generic_arm import JOINTS
from tci.viewer.view import WINDOW, History

GRID = np.linspace(-WINDOW, 0.0, 201)
"""Times [s] before now that are plotted."""
LINES = ("#1c7ed6", "#e8590c", "#2b8a3e", "#9c36b5", "#0b7285", "#c92a2a")


class Plots:
    """Plots in a panel of their own."""

    def __init__(self, server: viser.ViserServer, titles: Mapping[str, str], parts: tuple[str, ...]) -> None:
        """`titles` of the robots by key; `parts` to choose from."""
        self._titles = dict(titles)
        self._gui = server.gui
        self._part = self._gui.add_dropdown("arm", parts) if parts else None
        names = list(self._titles.values())
        self._force = self._add("force on the skin [N]", names)
        self._response = self._add("response: fastest servo [deg/s]", names)
        labels = [joint.replace("_", " ") for joint in JOINTS]
        self._angles = {
            key: self._add(f"{title}: generic angles [deg]", labels, height=150)
            for key, title in self._titles.items()
        }

    def update(self, histories: Mapping[str, History]) -> None:
        """Draw what is known now."""
        if self._part is None:
            return
        forces, responses = [], []
        for key in self._titles:
            time, force, response, angles = histories[key].series(self._part.value)
            before = time - time[-1] if len(time) else time
            forces.append(_on_grid(before, force))
            responses.append(np.rad2deg(_on_grid(before, response)))
            rows = [np.rad2deg(_on_grid(before, row)) for row in angles[: len(JOINTS)]]
            rows += [np.zeros(len(GRID))] * (len(JOINTS) - len(rows))
            self._angles[key].data = (GRID, *rows)
        self._force.data = (GRID, *forces)
        self._response.data = (GRID, *responses)

    def _add(self, title: str, names: list[str], *, height: int = 120) -> viser.GuiUplotHandle:
        series = [uplot.Series(label="before now [s]")]
        series += [
            uplot.Series(label=name, stroke=LINES[index % len(LINES)], width=2)
            for index, name in enumerate(names)
        ]
        empty = np.zeros(len(GRID))
        return self._gui.add_uplot(
            (GRID, *(empty for _ in names)),
            tuple(series),
            title=title,
            scales={"x": uplot.Scale(time=False, auto=False, range=(-WINDOW, 0.0))},
            legend=uplot.Legend(live=False),
            height=height,
        )


def _on_grid(before: Array, values: Array) -> Array:
    """Values at the plotted times; the first one before there were any. uPlot can't scale what is NaN."""
    if len(before) < 2:
        return np.zeros(len(GRID))
    return np.interp(GRID, before, values)
