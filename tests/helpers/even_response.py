"""Judge of the withdrawal reflex: touches every taxel of forearms and upper arms, in random postures too.

`python -m helpers.even_response [--json] [--anywhere] [--stride 1] [--postures 20] [--seed 0] [ROBOT...]` in
`tests/` prints one row for each robot, segment and force. It uses the public interface only, and knows
nothing of fields: what it compares are commands.

Postures are those of a human arm that the robot reaches without touching itself; with --anywhere, all that
the joints of the robot permit, also behind its back and near singular postures of its shoulder.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from dataclasses import asdict, dataclass, field

import numpy as np

import tci
from tci.robot.clearance import Clearance
from tci.testing import TouchedRobot

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
FORCES = (0.5, 1.0, 3.0, 10.0)
"""Forces [N]; the first is reported only."""
NEAR = 0.013
"""Distance [m] of two taxels that count as neighbours."""
HUMAN = np.deg2rad([[-10.0, 95.5], [0.0, 76.0], [-29.5, 65.0], [15.0, 88.5]])
"""Ranges of the first four generic angles of a human-like posture."""
CLEAR = 0.006
"""Least distance [m] between links in a posture."""


@dataclass
class Row:
    """All touches of one segment with one force."""

    robot: str
    segment: str
    force: float
    sizes: list[float] = field(default_factory=list)
    """Largest angle [degrees] of each command."""
    refused: Counter[str] = field(default_factory=Counter)
    nowhere: int = 0
    """Refused touches of which the reason says that no motion of the arm would do in this posture."""
    unsaid: int = 0
    """Touches that were felt, not answered, and for which no reason was told."""
    apart: float = 0.0
    """Largest difference [degrees] between the commands to one joint for two neighbours."""

    @property
    def least(self) -> float:
        """Least command as a fraction of the median."""
        return min(self.sizes) / float(np.median(self.sizes)) if self.sizes else 0.0

    @property
    def share(self) -> float:
        """Fraction of refused touches."""
        refused = sum(self.refused.values())
        return refused / max(refused + len(self.sizes), 1)

    @property
    def faults(self) -> list[str]:
        """What of the bar is missed."""
        found = []
        if self.least < 0.5:
            found.append(f"least command {self.least:.2f} of the median; valid: 0.5 or more")
        if self.share > 0.02:
            found.append(f"{self.share:.1%} refused; valid: 2 % or less")
        if self.apart >= 6.0:
            found.append(f"neighbours differ by {self.apart:.1f} degrees; valid: below 6")
        if self.unsaid:
            found.append(f"{self.unsaid} touches without answer and without a reason; valid: 0")
        return found if self.force >= 1.0 else []

    def __str__(self) -> str:
        median = float(np.median(self.sizes)) if self.sizes else np.nan
        return (
            f"{self.robot:6} {self.segment:10} {self.force:5.1f} N {len(self.sizes):7} answered, median "
            f"{median:5.1f} deg, least {self.least:.2f}, neighbours {self.apart:4.1f} deg, refused "
            f"{self.share:6.2%} {dict(self.refused)}, {self.nowhere} of them without any permitted motion "
            f"{'; '.join(self.faults)}"
        )


def postures(name: str, count: int, *, anywhere: bool = False, seed: int = 0) -> list[dict[str, np.ndarray]]:
    """The initial posture (empty), then `count` random postures of both arms, by generic part."""
    body, chance = tci.GenericBody(name), np.random.default_rng([seed, *name.encode()])
    clearance, robot = Clearance(body.robot), body.robot
    still = np.zeros(len(robot.servos))
    initial = np.array(TouchedRobot(name).perceive().joints.position)  # type: ignore[union-attr]
    arms = body.parts("arm")
    servos = sorted({int(servo) for part in arms for servo in body.joint_maps[part].servos})
    lower, upper = np.array([(robot.servos[i].limits.lower, robot.servos[i].limits.upper) for i in servos]).T
    found: list[dict[str, np.ndarray]] = [{}]
    while len(found) <= count:
        at = initial.copy()
        for part in arms:
            own = [k for k, servo in enumerate(servos) if servo in body.joint_maps[part].servos]
            while True:
                at[np.array(servos)[own]] = chance.uniform(lower[own], upper[own])
                angles = body.joint_maps[part].to_generic(at)[:4]
                if anywhere or bool(np.all((angles >= HUMAN[:, 0]) & (angles <= HUMAN[:, 1]))):
                    break
        rows, low, high = robot.coupling_rows
        fits = bool(np.all((rows @ at >= low) & (rows @ at <= high)))
        if fits and clearance.gap(at, within=0.02).distance >= CLEAR:
            posture = body.posture(tci.messages.JointReading(0.0, 0, at, still))
            found.append({part: posture[part] for part in arms})
    return found


def judged(
    name: str,
    *,
    count: int = 20,
    stride: int = 1,
    forces: tuple[float, ...] = FORCES,
    anywhere: bool = False,
    seed: int = 0,
    reflex: tci.WithdrawalReflex | None = None,
) -> list[Row]:
    """Touches every `stride`th taxel of the left arm, with each neighbour of it. The right arm is its mirror
    image; with a stride of 1 it is touched too, in every second posture."""
    reflex = reflex or tci.WithdrawalReflex()
    rows = {(s, f): Row(name, s, f) for s in ("upper_arm", "forearm") for f in forces}
    for number, posture in enumerate(postures(name, count, anywhere=anywhere, seed=seed)):
        touched = TouchedRobot(name, posture=posture)
        side = "right" if stride == 1 and number % 2 else "left"
        for patch in touched.robot.skin:
            if patch.part == f"{side}_arm" and patch.segment in ("upper_arm", "forearm"):
                for force in forces:
                    _touch(touched, reflex, patch.name, number % stride, stride, rows[patch.segment, force])
    return list(rows.values())


def _touch(
    touched: TouchedRobot, reflex: tci.WithdrawalReflex, patch: str, first: int, stride: int, row: Row
) -> None:
    at = touched.body.skin.surfaces[patch].positions
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    chosen = set(range(first, len(at), stride))
    around = chosen | {int(k) for one in chosen for k in np.flatnonzero(apart[one] <= NEAR)[:8]}
    commands: dict[int, np.ndarray] = {}
    for taxel in sorted(around):
        seen = touched.perceive(patch, taxel=taxel, force=row.force)
        if not len(seen.contacts):
            continue
        memory = reflex.init(touched.body)
        orders, memory = reflex.step(memory, seen, touched.body)
        part = touched.robot.patch(patch).part
        mine = [one.values - seen.posture[part] for one in orders if getattr(one, "part", "") == part]
        if mine:
            commands[taxel] = np.rad2deg(mine[0])
        elif taxel in chosen:
            reasons = reflex.notes(memory)
            row.nowhere += any("no other motion of its joints" in one for one in reasons)
            row.unsaid += not reasons and max(c.force for c in seen.contacts) > 0.3
            row.refused[_kind(reasons)] += 1
    row.sizes += [float(np.abs(commands[one]).max()) for one in chosen if one in commands]
    for one, other in zip(*np.nonzero(np.triu(apart <= NEAR, 1)), strict=True):
        if int(one) in commands and int(other) in commands:
            row.apart = max(row.apart, float(np.abs(commands[int(one)] - commands[int(other)]).max()))


def _kind(reasons: tuple[str, ...]) -> str:
    text = " ".join(reasons)
    for word in ("other skin", "press", "drag", "take"):
        if word in text:
            return word
    return text or "no reason"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--anywhere", action="store_true")
    parser.add_argument("--stride", type=int, default=1)
    parser.add_argument("--postures", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="draw of the random postures")
    given = parser.parse_args()
    faults = 0
    for name in given.robots:
        for row in judged(
            name, count=given.postures, stride=given.stride, anywhere=given.anywhere, seed=given.seed
        ):
            told = asdict(row) | {"sizes": len(row.sizes), "median": float(np.median(row.sizes or [0.0]))}
            told |= {"least": row.least, "share": row.share, "faults": row.faults}
            print(json.dumps(told) if given.json else row, flush=True)
            faults += len(row.faults)
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
