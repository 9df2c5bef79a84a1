"""Picture of the README: a recording as rows of a data set, and one policy that withdraws on three robots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import tci
from tci.capabilities.fields import default_fields
from tci.datasets import read_set
from tci.lab.pictures.camera import fit
from tci.lab.pictures.portrait import Portrait, keep_moment, lowest_shown

POLICY = Path(__file__).resolve().parents[1] / "examples" / "learning" / "withdraw.onnx"
ROBOTS = {
    "nao": "NAO, where it was trained",
    "icub": "iCub, the same file",
    "g1": "G1, the same file",
}
PART, FIELD, FPS, DURATION = "left_arm", "forearm_lateral", 100, 0.5
"""The finger pokes the centre of the reflex's field `FIELD`."""
PALE = 0.45
"""Share of the picture of the touch in that of both."""


def draw(folder: Path, path: Path) -> None:
    """Writes the picture; the recordings go into `folder`."""
    figure = plt.figure(figsize=(10.0, 2.5), layout="constrained")
    rows, *places = figure.subplots(1, 4, width_ratios=[1.3, 1, 1, 1])
    for axes, (robot, title) in zip(places, ROBOTS.items(), strict=True):
        axes.imshow(_poke(robot, folder / f"{robot}.mcap"))
        axes.set_axis_off()
        axes.set_title(title, fontsize=9, loc="left")
    _draw_rows(rows, folder / "nao.mcap")
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _poke(name: str, file: Path) -> NDArray[np.uint8]:
    """Records the policy on a poked robot, and returns one picture of the touch, pale, and of the farthest
    posture."""
    policy = tci.PolicyCapability(POLICY)
    field = next(one.place for one in default_fields() if one.name == FIELD)
    with tci.connect(name) as driver, tci.Recorder(file, driver.robot) as recorder:
        place = tci.GenericBody(driver.robot).place(PART, field, driver.read().joints)
        driver.world.finger.poke(place.patch, place.p_L, place.n_L)
        home = driver.read().joints.position
        shown, most = {"touched": keep_moment(driver.world, driver.read())}, {"touched": 0.0, "away": 0.0}

        def see(tick: tci.Tick) -> None:
            recorder.tick(tick.now, tick.reading, tick.commands, tick.sent, tick.perception)
            away = float(np.abs(tick.reading.joints.position - home).max())
            for name, value in (("touched", driver.world.finger.force), ("away", away)):
                if value > most[name]:
                    shown[name], most[name] = keep_moment(driver.world, tick.reading), value

        tci.run(driver, policy, duration=DURATION, observe=see)
        portrait, moments = Portrait(driver.world, (), full_scale=150e3), list(shown.values())
        lowest = lowest_shown(driver.robot, PART, 0.3)
        outlines = [portrait.outline(moment, part=PART, lowest=lowest) for moment in moments]
        camera = fit(
            np.concatenate(outlines), azimuth=0.9, elevation=0.2, width=400, height=400,
            frame=portrait.torso(moments[0]),
        )  # fmt: skip
        touched, away = (portrait.draw(moment, camera).astype(float) for moment in moments)
        return np.rint(PALE * touched + (1.0 - PALE) * away).astype(np.uint8)


def _draw_rows(axes: Any, file: Path) -> None:
    """Forces on the taxels that were touched, and the angle that the policy's action moved most."""
    data = read_set([file], fps=FPS)
    blocks = list(data.blocks(data.episodes[0]))
    forces = np.concatenate([block["observation.tactile.left_forearm"] for block in blocks])
    action = np.rad2deg(np.concatenate([block["action"] for block in blocks]))
    action = action - action[0]
    touched = np.flatnonzero(forces.max(axis=0) > 0.0)
    axes.imshow(
        forces[:, touched].T,
        aspect="auto",
        cmap="magma",
        extent=(0, len(forces), 0, len(touched)),
        origin="lower",
        interpolation="nearest",
    )
    axes.set(xlabel="row of the data set", ylabel="touched taxels")
    right = axes.twinx()
    right.plot(action[:, np.abs(action).max(axis=0).argmax()], color="tab:cyan", linewidth=1.5)
    right.set_ylabel("action [degrees]", color="tab:cyan")
    axes.set_title("a touch in the data set", fontsize=9, loc="left")
