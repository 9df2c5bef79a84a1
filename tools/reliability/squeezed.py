"""Moves arms of robots against somebody who can't give way, and looks at the force that is left."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from pool import gather
from row import Row

import tci
from helpers.squeezed import By, draw, draw_between, squeeze
from tci.gate.settings import GateSettings
from tci.messages import Mode

ROBOTS = ("nao", "icub", "g1", "talos")
STIFF, LONG, FELT, BARE = 65.0, 0.2, 15.0, 30.0
"""Force [N] that is permitted half a second after the contact, time [s] for which more is, and forces [N]
that may be left after 2 s on skin and on bare links. ISO/TS 15066's least quasi-static limit is 65 N."""


def squeezed(full: bool) -> Row:
    """Only trials count in which the person is still squeezed after 2 s when the gate does not answer. In a
    third of them a second person stands up to 20 mm behind the link, in another third the arm comes down on
    somebody below it, and most of the rest are between the arm and the robot itself. In position mode every
    second arm plays a gesture, and half of these a lesson."""
    modes = ("position", "velocity", "impedance") if full else ("position",)
    jobs = [(name, mode, seed) for seed in range(300 if full else 3) for name in ROBOTS for mode in modes]
    done = [one for one in gather("squeezed", _one, jobs, full=full) if one["counts"]]
    over = [one for one in done if one["faults"]]
    print(*over, sep="\n")
    shares = {name: [not one["faults"] for one in done if one["robot"] == name] for name in ROBOTS}
    words = ", ".join(f"{name} {sum(own)} of {len(own)}" for name, own in shares.items())
    return Row(
        "somebody who can't give way before a moving arm, on a plant that shares nothing with the gate",
        len(done),
        300 * len(ROBOTS),
        "trials",
        f"freed: {words}; largest peak {max((one['peak'] for one in done), default=0.0):.0f} N",
        "after 0.5 s at most 65 N, above 65 N for at most 0.2 s, after 2 s at most 15 N (skin), 30 N (bare)",
        not over,
    )


def _one(name: str, mode: str, seed: int) -> dict[str, Any]:
    robot = tci.load_robot(name)
    by: By = "gesture" if mode == "position" and seed % 2 else "order"
    trial = draw_between(robot, seed, mode=Mode(mode), by=by) if seed % 9 in (0, 3) else None
    trial = trial or draw(robot, seed, mode=Mode(mode), by=by, below=seed % 3 == 1)
    if by == "gesture" and seed % 4 == 3:
        trial = replace(trial, by="lesson")
    before = squeeze(robot, trial, settings=GateSettings(contact=None))
    most = FELT if before.felt else BARE
    if before.late <= most:
        return {"robot": name, "counts": False}
    behind = float(np.random.default_rng(seed).uniform(0.0, 0.02)) if seed % 3 == 2 else None
    after = squeeze(robot, trial, behind=behind)
    faults = [
        what
        for what, wrong in (
            ("0.5 s", max(after.half, after.other[1]) > STIFF),
            ("long", after.over > LONG),
            ("2 s", max(after.late, after.other[2]) > (FELT if after.felt else BARE)),
        )
        if wrong
    ]
    seen = {key: value for key, value in asdict(after).items() if key != "force"}
    return {"robot": name, "mode": mode, "seed": seed, "counts": True, "faults": faults, **seen}
