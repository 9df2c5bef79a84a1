"""Moves arms of robots against somebody who can't give way, and looks at the force that is left."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any, cast

import numpy as np
from pool import gather
from row import Row

import tci
from helpers.rigid_robot import WIRE
from helpers.squeezed import By, Pressed, Squeeze, squeeze
from helpers.squeezes import draw, draw_between, draw_in_elbow
from tci.gate.settings import GateSettings, over_a_wire
from tci.messages import Mode
from tci.robot.description import Robot

ROBOTS = ("nao", "icub", "g1", "talos")
STIFF, LONG, FELT, BARE = 65.0, 0.2, 15.0, 30.0
"""Force [N] that is permitted half a second after the contact, time [s] for which more is, and forces [N]
that may be left after 2 s on skin and on bare links. ISO/TS 15066's least quasi-static limit is 65 N."""
PLACES = {"on the way": 0.2, "below": 0.4, "against itself": 0.2, "in the elbow": 0.2}
"""Where somebody is, by share of the trials in which no reflex moves the arm."""
SOMETIMES = 0.25
"""Share of the trials with a second person, with a STOP for another cause, with a link that is cut, and of
those that are made again over a wire."""
WIRED = ("icub", "talos")
"""Robots whose joint torques come over a wire, and whose servos stay stiff there."""


def squeezed(full: bool) -> Row:
    """Only trials count in which the person is still squeezed after 2 s when the gate does not answer. What
    moves the arm, where somebody is, and what else happens is drawn at random. What is left after a cut link
    is told, not judged: these robots obey set-points of one period. So is what is met over a wire, by an arm
    that moved before."""
    modes = ("position", "velocity", "impedance") if full else ("position",)
    jobs = [(name, mode, seed) for seed in range(300 if full else 3) for name in ROBOTS for mode in modes]
    done = [one for one in gather("squeezed", _one, jobs, full=full) if one["counts"]]
    over = [one for one in done if one["faults"]]
    cut, wired = ([one for one in done if one[how]] for how in ("cut", "wired"))
    print(*over, sep="\n")
    kinds = {kind: _freed(done, lambda one, kind=kind: kind in one["kinds"])
             for kind in dict.fromkeys(kind for one in done for kind in one["kinds"])}  # fmt: skip
    shares = {name: _freed(done, lambda one, name=name: one["robot"] == name) for name in ROBOTS}
    told = "; ".join(", ".join(f"{key} {own}" for key, own in found.items()) for found in (shares, kinds))
    left = sum(bool(one["cut"]["faults"]) for one in cut)
    freed = sum(not one["wired"]["faults"] for one in wired)
    return Row(
        "somebody who can't give way before a moving arm, on a plant that shares nothing with the gate",
        len(done),
        300 * len(ROBOTS),
        "trials",
        f"freed: {told}; largest peak {max((one['peak'] for one in done), default=0.0):.0f} N; "
        f"when the link is cut after the first order {left} of {len(cut)} stay squeezed, over a wire "
        f"{freed} of {len(wired)} are freed (neither is judged)",
        "after 0.5 s at most 65 N, above 65 N for at most 0.2 s, after 2 s, and after a reset, at most 15 N "
        "(skin), 30 N (bare)",
        not over,
    )


def _freed(done: list[dict[str, Any]], among: Callable[[dict[str, Any]], bool]) -> str:
    own = [not one["faults"] for one in done if among(one)]
    return f"{sum(own)} of {len(own)}"


def _drawn(robot: Robot, seed: int, mode: Mode, random: np.random.Generator) -> tuple[Squeeze, str]:
    """A trial, and where somebody is in it."""
    by = cast(
        By,
        random.choice(
            ["order", "gesture", "lesson", "reflex"] if mode is Mode.POSITION else ["order", "reflex"]
        ),
    )
    place = "on the way" if by == "reflex" else str(random.choice([*PLACES], p=[*PLACES.values()]))
    # a lesson moves the arm as its gesture does, but later
    how: dict[str, Any] = {"mode": mode, "by": "gesture" if by == "lesson" else by}
    trial = None
    if place in ("against itself", "in the elbow"):
        trial = (draw_between if place == "against itself" else draw_in_elbow)(robot, seed, **how)
        place = place if trial else "on the way"
    trial = replace(trial or draw(robot, seed, **how, below=place == "below"), by=by)
    if random.random() < SOMETIMES:
        trial = replace(trial, stops=float(random.uniform(0.0, 0.5)))
    return trial, place


def _one(name: str, mode: str, seed: int) -> dict[str, Any]:
    robot, random = tci.load_robot(name), np.random.default_rng([seed, ROBOTS.index(name)])
    trial, place = _drawn(robot, seed, Mode(mode), random)
    behind = float(random.uniform(0.0, 0.02)) if random.random() < SOMETIMES else None
    cut, wired = (random.random(2) < SOMETIMES).tolist()
    before = squeeze(robot, trial, settings=GateSettings(contact=None))
    if before.late <= _most(before):
        return {"robot": name, "counts": False}
    after = squeeze(robot, trial, behind=behind)
    kinds = [trial.by, place]
    kinds += ["a second person"] if behind is not None else []
    kinds += ["STOP"] if trial.stops is not None else []
    seen = {key: value for key, value in asdict(after).items() if key != "force"}
    left = squeeze(robot, trial, cut=True) if cut else None
    far = over_a_wire(softens=False)
    there = wired and name in WIRED
    over = squeeze(robot, trial, settings=far, dirt=WIRE, sways=True) if there else None
    return {
        "robot": name, "mode": mode, "seed": seed, "counts": True, "kinds": kinds,
        "faults": sorted({*_faults(after), *_faults(after.other)}), **seen,
        "cut": _told(left), "wired": _told(over),
    }  # fmt: skip


def _told(one: Pressed | None) -> dict[str, Any] | None:
    return None if one is None else {"faults": _faults(one), "half": one.half, "late": one.late}


def _most(one: Pressed) -> float:
    return FELT if one.felt else BARE


def _faults(one: Pressed) -> list[str]:
    bars = {"0.5 s": one.half > STIFF, "long": one.over > LONG, "2 s": one.late > _most(one),
            "reset": one.reset > _most(one)}  # fmt: skip
    return [what for what, missed in bars.items() if missed]
