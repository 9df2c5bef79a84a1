"""Picture of docs/conditioning.md: raw data of a real iCub's foot sole. The robot stood and was then lifted.

The positions of the channels are read from the foot's position file. The values show which channels are
taxels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tci.lab.authoring.calibrate_skin import calibrate
from tci.lab.authoring.live_channels import live_channels
from tci.messages import SkinFrame
from tci.robot.catalogue import load_robot
from tci.robot.description import Patch, Sensor, Table
from tci.robot.skin_files.layout import SkinLayout as TaxelTable
from tci.robot.skin_files.reader import read_layout
from tci.skin.conditioning import Conditioner
from tci.skin.contacts import ContactFinder
from tci.skin.layout import SkinLayout, SkinPatch
from tci.skin.surfaces import Surface, find_neighbours

SENSOR = Sensor(rest=240.0, pascal_per_count=-450.0, lowest=0.0, highest=255.0)
MOMENTS = (5.0, 11.2, 14.05, 15.45, 17.6)
"""Times [s] at which the maps of the picture show the frame."""


def read_raw(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns times (n,) [s] since the first frame, and raw frames (n, channels), of a yarpdatadumper log."""
    rows = np.array([line.split() for line in path.read_text().splitlines()], dtype=np.float64)
    return rows[:, 1] - rows[0, 1], rows[:, 2:]


def draw(data: Path, out: Path) -> None:
    """Writes the picture. `data` is the folder of recordings and position files."""
    times, values = read_raw(data / "recordings" / "icub_right_foot_raw_01.log")
    layout = read_layout(data / "icub" / "positions" / "right_foot.txt")
    taxels = np.flatnonzero(live_channels(values) & layout.valid)
    neighbours = find_neighbours(layout.positions[taxels], layout.normals[taxels])
    unloaded = values[np.sort(np.argsort(-values[:, taxels].mean(axis=1))[:40])][:, taxels]
    patch = Patch(
        name="right_foot", part="right_leg", segment="foot", link="r_sole", rate=50.0,
        channels=values.shape[1], sensor=SENSOR, surface=Table(file="right_foot.txt", format="icub"),
    )  # fmt: skip
    normals, areas = layout.normals[taxels], layout.areas[taxels]
    surface = Surface(
        patch.name, patch.link, layout.positions[taxels], normals, areas, taxels, neighbours,
        np.zeros((0, 3), np.intp),
    )  # fmt: skip
    leg = load_robot("icub-whole").part(patch.part)
    skin = SkinLayout.of([SkinPatch(patch, surface, leg, None, calibrate(SENSOR, areas, unloaded, []))])
    conditioner, forces = Conditioner(skin), np.zeros((len(values), len(taxels)))
    finder = ContactFinder(skin)
    contacts = []
    for k, (frame, stamp) in enumerate(zip(values, times, strict=True)):
        conditioner.step([SkinFrame(patch.name, float(stamp), k, frame)])
        forces[k] = conditioner.state.on(0) * areas
        found = finder.find(
            conditioner.state, conditioner.estimates, lambda: np.eye(4)[None], {patch.part: np.zeros(5)}
        )
        contacts.append([contact.taxels for contact in found])
    _figure(layout, taxels, times, forces, contacts).savefig(out, dpi=110)


def _figure(
    layout: TaxelTable,
    taxels: NDArray[np.intp],
    times: NDArray[np.float64],
    forces: NDArray[np.float64],
    contacts: list[list[NDArray[np.intp]]],
) -> Figure:
    figure = Figure(figsize=(11.0, 6.2), layout="constrained")
    rows = figure.add_gridspec(2, len(MOMENTS), height_ratios=(1.0, 1.6))
    axes = figure.add_subplot(rows[0, :])
    for rank in range(max(map(len, contacts))):
        each = [sorted((float(force[one].sum()) for one in found), reverse=True) for force, found in
                zip(forces, contacts, strict=True)]  # fmt: skip
        axes.plot(times, [own[rank] if rank < len(own) else np.nan for own in each], lw=1.4)
    for moment in MOMENTS:
        axes.axvline(moment, color="0.7", lw=0.8, zorder=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("force of each contact [N]")
    axes.set_title("Sole of a real iCub: contacts over time (strongest first)", loc="left")
    axes.margins(x=0.0)
    places = 1e3 * layout.positions[taxels]
    top = float(forces.max())
    dots = None
    for column, moment in enumerate(MOMENTS):
        axes = figure.add_subplot(rows[1, column])
        now = int(np.argmin(np.abs(times - moment)))
        dots = axes.scatter(
            places[:, 1], places[:, 0], c=forces[now], s=26, cmap="inferno_r", vmin=0.0, vmax=top,
            edgecolors="0.6", linewidths=0.4,
        )  # fmt: skip
        for one in contacts[now]:
            centre = forces[now][one] @ places[one] / forces[now][one].sum()
            axes.plot(centre[1], centre[0], "+", color="tab:cyan", ms=12, mew=2.2)
        axes.set_title(
            f"{times[now]:.1f} s: {forces[now].sum():.0f} N, {len(contacts[now])} contacts", fontsize=9
        )
        axes.set_aspect("equal")
        axes.invert_xaxis()
        axes.set_xticks([])
        axes.set_yticks([])
    figure.colorbar(dots, ax=figure.axes[1:], label="force on a taxel [N]", shrink=0.8)
    return figure
