"""Searches gains and base motions of the withdrawal reflex in many worlds, and judges them on other robots.

python tools/reflex_search.py [--robots nao icub] [--held-out g1 talos] [--candidates 40] [--json FILE]

Fingers of 10 to 75 N/mm press into the skin of both arms at 0.02 to 0.25 m/s, and stay. Counted are the peak
force, and the force that is left 0.2 to 0.6 s after the first contact; both as fractions of what the packaged
reflex gets at the same places. The limiter goes as fast as the servos may, so a candidate is never slower
than a gate would let it be. Where the fields lie, and so where the reflex answers, is not changed.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np

from tci.batch import Answers, BatchScene, MujocoWorlds, batch_scene
from tci.capabilities.fields import ReceptiveField, default_fields, default_surround
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.messages.frames import Array
from tci.simulation.finger import MASS

STIFFNESSES = (10e3, 25e3, 75e3)
"""[N/m], of an abdomen, a back or arm, and a hand (ISO/TS 15066)."""
TRAINED = 25e3
STEP, PERIOD, LENGTH = 0.0005, 0.01, 1.0
"""Step of the physics [s]: with a longer one the hardest finger swings."""
KEPT = 0.2, 0.6
"""Time [s] after the first contact in which the force counts as kept."""
POKES = 48


@dataclass(frozen=True)
class Candidate:
    """Factors on the packaged base motions, and the range of force [N] of the answer."""

    shoulder: float = 1.0
    elbow: float = 1.0
    turn: float = 1.0
    threshold: float = 0.2
    saturation: float = 2.0

    def reflex(self, *, spares: bool = False) -> WithdrawalReflex:
        """The reflex, at full speed or at one that spares whoever stands in its way."""
        factors = np.array([self.shoulder, self.shoulder, self.turn, self.elbow, 1.0])

        def changed(one: ReceptiveField) -> ReceptiveField:
            motion = tuple((factors * one.motion).tolist())
            new = {"motion": motion, "threshold": self.threshold, "saturation": self.saturation}
            return one.model_copy(update=new)

        fields, surround = (tuple(map(changed, own)) for own in (default_fields(), default_surround()))
        reflex = WithdrawalReflex(fields=fields, surround=surround)
        return reflex if spares else replace(reflex, people=())


def drawn(chance: np.random.Generator, most: float) -> Candidate:
    """A candidate whose motions are at most `most` times the packaged ones."""
    threshold = float(chance.uniform(0.05, 0.4))
    motions = chance.uniform(0.4 * most, most, 3).tolist()
    return Candidate(*motions, threshold, threshold + float(chance.uniform(0.2, 4.0)))


@cache
def scene_of(robot: str, stiffness: float) -> BatchScene:
    """A scene with a finger of `stiffness` [N/m]."""
    scene = batch_scene(robot, step=STEP, period=PERIOD)
    finger, damping = scene.world.finger, 1.4 * np.sqrt(stiffness * MASS)
    scene.model.actuator_gainprm[finger.actuator, 0] = stiffness
    scene.model.actuator_biasprm[finger.actuator, 1:3] = -stiffness, -damping
    finger.state["leads"] = damping / stiffness
    return scene


@cache
def places(robot: str, seed: int) -> tuple[tuple[str, int], ...]:
    """Taxels of the arms at which there is room for the finger."""
    scene, chance, found = scene_of(robot, TRAINED), np.random.default_rng(seed), list[tuple[str, int]]()
    sleeves = [one.name for one in scene.robot.patches if one.segment]
    while len(found) < POKES:
        patch = str(chance.choice(sleeves))
        taxel = int(chance.integers(len(scene.world.surfaces[patch].positions)))
        try:
            scene.world.finger.poke(patch, taxel)
        except TciError:
            continue
        found.append((patch, taxel))
    scene.world.reset()
    return tuple(found)


def forces(robot: str, stiffness: float, candidate: Candidate | None, seed: int) -> Array:
    """Peak and kept force (2, POKES) [N] of pokes; None stands still."""
    where, chance = places(robot, seed), np.random.default_rng(seed)
    worlds = MujocoWorlds(scene_of(robot, stiffness), POKES, threads=1)
    answers = Answers(worlds, candidate.reflex()) if candidate else None
    worlds.advance(STEP)
    worlds.poke(
        [patch for patch, _ in where], [taxel for _, taxel in where],
        speed=np.exp(chance.uniform(*np.log([0.02, 0.25]), POKES)), depth=chance.uniform(0.006, 0.014, POKES),
    )  # fmt: skip
    trace = []
    while worlds.time < LENGTH:
        if answers:
            answers.step()
        worlds.advance(PERIOD / 2)
        trace.append(worlds.finger_force.copy())
        worlds.advance(PERIOD / 2)
        trace.append(worlds.finger_force.copy())
    rows, peak = np.array(trace), worlds.finger_peak
    begun = (rows > 0.0).argmax(axis=0) * PERIOD / 2
    late = np.arange(len(rows))[:, None] * PERIOD / 2 - begun
    kept = np.where((late >= KEPT[0]) & (late <= KEPT[1]), rows, np.nan)
    return np.array([peak, np.nanmean(kept, axis=0)])


def judged(job: tuple[str, float, Candidate | None, int]) -> list[float]:
    """Mean peak and mean kept force [N]."""
    mean: list[float] = forces(*job).mean(axis=1).tolist()
    return mean


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--robots", nargs="+", default=["nao", "icub"])
    words.add_argument("--held-out", nargs="*", default=["g1", "talos"])
    words.add_argument("--candidates", type=int, default=40)
    words.add_argument(
        "--most", type=float, nargs="+", default=[1.0, 2.0], help="largest motion, as a factor"
    )
    words.add_argument("--processes", type=int, default=1)
    words.add_argument("--json", type=Path)
    given, chance = words.parse_args(), np.random.default_rng(0)
    default, told = Candidate(), list[dict[str, object]]()
    with ProcessPoolExecutor(given.processes) as pool:

        def table(
            robots: list[str], hard: tuple[float, ...], tried: list[Candidate | None], seed: int
        ) -> Array:
            """Mean peak and kept force (candidates, cases, 2) [N]."""
            jobs = [(r, k, c, seed) for (r, k), c in product(product(robots, hard), tried)]
            found = np.array([*pool.map(judged, jobs, chunksize=max(len(tried) // 8, 1))])
            return found.reshape(-1, len(tried), 2).swapaxes(0, 1)

        def tell(what: str, robots: list[str], one: Candidate | None, row: Array) -> None:
            peak, kept = row.mean(axis=0).tolist()
            told.append(
                {"what": what, "robots": robots, "peak": peak, "kept": kept} | (asdict(one) if one else {})
            )
            print(f"{what} on {', '.join(robots)}: peak x{peak:.3f}, kept x{kept:.3f}  {one}", flush=True)

        best = list[Candidate]()
        for most in given.most:
            tried = [default, *(drawn(chance, most) for _ in range(given.candidates))]
            forced = table(given.robots, (TRAINED,), [*tried], 1)
            shares = forced / forced[:1]
            for one, row in zip(tried, shares, strict=True):
                tell(f"tried, motions up to x{most:g}", given.robots, one, row)
            best.append(tried[int(shares.mean(axis=(1, 2)).argmin())])
        curve = [Candidate(one, one, one) for one in (0.25, 0.5, 0.75, 1.25, 1.5, 2.0)]
        tried_late: list[Candidate | None] = [default, None, *best, *curve]
        names = ["packaged", "standing still", *(f"best, motions up to x{m:g}" for m in given.most)]
        names += [f"motions x{one.shoulder:g}" for one in curve]
        for robots in filter(None, (given.robots, given.held_out)):
            forced = table(robots, STIFFNESSES, tried_late, 2)
            print(f"packaged on {', '.join(robots)}: peak and kept [N] by stiffness", flush=True)
            print(forced[0].round(1).tolist(), flush=True)
            for name, late, row in zip(names, tried_late, forced / forced[:1], strict=True):
                tell(name, robots, late, row)
    if given.json:
        given.json.write_text(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
