"""Pokes both arms of every robot at random places in random postures. The skin must leave the finger within a
second, or the reflex say why."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row
from whole_arm import LEAST, ROBOTS

import tci
from helpers.even_response import postures
from tci.errors import TciError

POSTURES, POKES = 20, 50
"""Postures of a robot at full size, and pokes in each of them."""
FORCES = 0.5, 10.0
"""Range [N] of what the finger presses an arm with that does not move."""
SOFT = 800.0
"""Stiffness [N/m] of the finger."""


def moved_arm(full: bool) -> Row:
    """Pokes forearms and upper arms with 0.5 to 10 N, in 20 postures of each robot."""
    jobs = [(name, seed, POKES if full else 6) for seed in range(POSTURES if full else 5) for name in ROBOTS]
    done = [one for job in gather("moved_arm", _poke, jobs, full=full) for one in job["pokes"]]
    shares = {
        name: np.mean([one["left"] for one in done if one["robot"] == name] or [0.0]) for name in ROBOTS
    }
    unsaid = [one for one in done if not one["left"] and not one["reason"]]
    print(*(one for one in done if not one["left"]), sep="\n")
    words = ", ".join(f"{name} {share:.1%}" for name, share in shares.items())
    return Row(
        f"withdrawal reflex to pokes of arms in random postures, {len(ROBOTS)} robots",
        len(done),
        POSTURES * POKES * len(ROBOTS),
        "pokes",
        f"fingers left within 1 s: {words}; {len(unsaid)} not left without a reason",
        f"{LEAST:.0%} left on each robot, the others with a reason",
        not unsaid and min(shares.values()) >= LEAST,
    )


def _poke(name: str, seed: int, count: int) -> dict[str, Any]:
    posture, chance = postures(name, 1, seed=seed)[1], np.random.default_rng([seed, *name.encode()])
    world, reflex = tci.World(name, posture=posture, seed=seed), tci.WithdrawalReflex()
    patches = [
        one for one in world.robot.skin if one.part in posture and one.segment in ("upper_arm", "forearm")
    ]
    sizes = np.array([len(world.surfaces[one.name].positions) for one in patches])
    pokes: list[dict[str, Any]] = []
    while len(pokes) < count:
        patch = patches[chance.choice(len(patches), p=sizes / sizes.sum())].name
        taxel, force = (
            int(chance.integers(len(world.surfaces[patch].positions))),
            float(chance.uniform(*FORCES)),
        )
        world.reset()
        try:
            world.finger.poke(patch, taxel, depth=force / SOFT)
        except TciError:
            continue  # no room
        result = tci.run(tci.connect(name, "sim", world=world), reflex, duration=1.3)
        begun, lost = world.finger.first_contact, world.finger.contact_lost
        pokes.append({
            "robot": name, "posture": seed, "patch": patch, "taxel": taxel, "force_n": round(force, 2),
            "left": begun is not None and lost is not None and lost - begun <= 1.0,
            "reason": "; ".join(note for note in reflex.notes(result.memory) if "withdraws at" not in note),
        })  # fmt: skip
    return {"pokes": pokes}
