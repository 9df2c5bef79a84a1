"""Plots of the last seconds: force and response of all robots, and joint angles of each robot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser
from viser import uplot

from tci.lab.viewer.view import WINDOW, History
from tci.messages.frames import Array
from tci.robot.generic_arm import JOINTS

GRID = np.linspace(-WINDOW, 0.0, 201)
"""Times [s] of the plotted points, relative to now."""
LEAST_FORCE, LEAST_RESPONSE = 6.0, 60.0
"""Smallest upper end of the axis of force [N] and of the axis of response [deg/s]. Assumed: these two values
change only the picture."""
ANGLE, ROOM = 15.0, 2.0
"""Step [deg] to which the ends of an angle axis are rounded, and smallest distance [deg] between these ends
and the plotted lines. Assumed: the two values change only the picture."""
LINES = ("#1c7ed6", "#e8590c", "#2b8a3e", "#9c36b5", "#0b7285", "#c92a2a")


class Plots:
    """Plots in a separate panel of the page."""

    def __init__(self, server: viser.ViserServer, titles: Mapping[str, str], parts: tuple[str, ...]) -> None:
        """Adds the plots. `titles` contains the title of each robot, with the keys that `update` uses. On the
        page, a person can choose one of the generic parts `parts`."""
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
        """Draws the last seconds of `histories`, which contain the history of each robot."""
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
            _draw(self._angles[key], rows, _around(rows))
        _draw(self._force, forces, (0.0, _top(forces, LEAST_FORCE)))
        _draw(self._response, responses, (0.0, _top(responses, LEAST_RESPONSE)))

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
            scales=_scales((0.0, 1.0)),
            legend=uplot.Legend(live=False),
            height=height,
        )


def _draw(plot: viser.GuiUplotHandle, rows: list[Array], ends: tuple[float, float]) -> None:
    scales = _scales(ends)
    if plot.scales != scales:
        plot.scales = scales
    plot.data = (GRID, *rows)


def _scales(ends: tuple[float, float]) -> dict[str, uplot.Scale]:
    return {
        "x": uplot.Scale(time=False, auto=False, range=(-WINDOW, 0.0)),
        "y": uplot.Scale(auto=False, range=ends),
    }


def _top(rows: list[Array], least: float) -> float:
    """Returns a round upper end for an axis: `least` times the smallest of 1, 2, 5, 10, 20 ... with which the
    end is above all values of `rows`."""
    largest = max((float(row.max()) for row in rows), default=0.0)
    decade = 1.0
    while True:
        for step in (1.0, 2.0, 5.0):
            if largest < least * step * decade:
                return least * step * decade
        decade *= 10.0


def _around(rows: list[Array]) -> tuple[float, float]:
    """Returns the lower and upper end [deg] of an angle axis with all values of `rows`. The ends are
    multiples of 15 degrees (`ANGLE`)."""
    low = np.floor((min(float(row.min()) for row in rows) - ROOM) / ANGLE) * ANGLE
    high = np.ceil((max(float(row.max()) for row in rows) + ROOM) / ANGLE) * ANGLE
    return float(low), float(high)


def _on_grid(before: Array, values: Array) -> Array:
    """Interpolates `values` at the plotted times. `before` are the times [s] of the values relative to now.
    At times before the first value, the result repeats this value, because uPlot can't scale NaN. With fewer
    than two values, the result is 0."""
    if len(before) < 2:
        return np.zeros(len(GRID))
    return np.interp(GRID, before, values)
