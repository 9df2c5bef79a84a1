"""The same pokes in worlds of `mujoco.batch` and of mujoco-warp, compared with each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.batch import Answers
from tci.batch.cpu import MujocoWorlds
from tci.batch.gpu import WarpWorlds
from tci.batch.scene import BatchScene
from tci.batch.worlds import Worlds
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages.contacts import Contacts
from tci.messages.frames import Array

FRAME, MOVES = 0.02, 10
"""Time [s] between two looks, and the number of that before which an arm begins to move."""
Mask = NDArray[np.bool_]


def poke_all(worlds: Worlds, chance: np.random.Generator) -> None:
    """Pokes another place in each world, each with its own depth and speed: at one speed for all, fingers
    would all touch at the very beginning of a step, or at its end, as rounding has it."""
    scene, count = worlds.scene, worlds.count
    sleeves = [one.name for one in scene.robot.patches if one.segment]
    names = [str(chance.choice(sleeves)) for _ in range(count)]
    taxels = [int(chance.integers(len(scene.world.surfaces[name].positions))) for name in names]
    depth, speed = chance.uniform(0.004, 0.014, count), chance.uniform(0.1, 0.25, count)
    worlds.poke(names, taxels, depth=depth, speed=speed)


@dataclass(frozen=True)
class Pokes:
    """What 0.5 s of pokes were like on both engines, of which one arm's first joint moves by 0.3 rad."""

    differences: Array
    """Largest difference of forces on taxels in each touched frame, as a fraction of the largest force."""
    touched: int
    """Frames (of one world each) with a contact on either engine."""
    inner: int
    """Those that are more than 20 ms from the beginning and the end of a contact."""
    same_taxels: int
    """Inner ones with the same contacts on the same taxels."""
    same_forces: int
    """Inner ones whose contacts also have the same force within 1 %."""
    same_begin: int
    """Worlds whose contact begins in the same step of the physics."""


def compare_pokes(scene: BatchScene, count: int, device: str | None, seed: int) -> Pokes:
    cpu, gpu = both = MujocoWorlds(scene, count), WarpWorlds(scene, count, device=device)
    for worlds in both:
        poke_all(worlds, np.random.default_rng(seed))
    differences, seen = [], np.zeros((25, 3, count), bool)
    arm = int(scene.body.joint_maps["left_arm"].servos[0])
    for frame in range(len(seen)):
        for worlds in both:
            if frame == MOVES:
                targets = np.full(worlds.joints.shape, np.nan)
                targets[:, arm] = worlds.joints[:, arm] + 0.3
                worlds.send(targets)
            worlds.advance(frame * FRAME + scene.step - worlds.time)
        pairs = [(cpu.contacts(w), gpu.contacts(w)) for w in range(count)]
        seen[frame] = [
            cpu.touched | gpu.touched, [have_same_taxels(*pair) for pair in pairs],
            [have_same_forces(*pair) for pair in pairs],
        ]  # fmt: skip
        loaded = cpu.force.max(axis=1) > 0.01
        largest = cpu.force[loaded].max(axis=1)
        differences += [*np.abs(gpu.force - cpu.force)[loaded].max(axis=1) / largest]
    touched, taxels, forces = seen.swapaxes(0, 1)
    inner = touched[2:-2] & touched[1:-3] & touched[3:-1] & touched[:-4] & touched[4:]
    return Pokes(
        np.array(differences), int(touched[2:-2].sum()), int(inner.sum()), int(taxels[2:-2][inner].sum()),
        int(forces[2:-2][inner].sum()),
        int((np.abs(cpu._pokes["end"] - gpu._pokes.numpy()["end"]) < 1e-6).sum()),
    )  # fmt: skip


def have_same_taxels(one: Contacts, other: Contacts) -> bool:
    return [c.patch for c in one] == [c.patch for c in other] and all(
        np.array_equal(a.taxels, b.taxels) for a, b in zip(one, other, strict=True)
    )


def have_same_forces(one: Contacts, other: Contacts) -> bool:
    return have_same_taxels(one, other) and bool(np.all(np.abs(one.force / other.force - 1.0) <= 0.01))


@dataclass(frozen=True)
class Withdrawals:
    """How the reflex answered pokes on both engines."""

    begun: tuple[int, int]
    """Withdrawals on each engine."""
    together: int
    """Those that begin in the same frame on both."""
    first: Array
    """Largest difference [rad] of the first targets of each of these."""


def compare_withdrawals(
    scene: BatchScene, count: int, device: str | None, seed: int, seconds: float, again: float = np.inf
) -> Withdrawals:
    """Pokes all worlds at the beginning, and once more at the time `again` [s]."""
    begun: list[dict[Any, Array]] = []
    for worlds in (MujocoWorlds(scene, count), WarpWorlds(scene, count, device=device)):
        reflex, chance, own = (
            Answers(worlds, WithdrawalReflex()),
            np.random.default_rng(seed),
            dict[Any, Array](),
        )
        poke_all(worlds, chance)
        for frame in range(round(seconds / FRAME)):
            if frame == round(min(again, seconds) / FRAME):
                poke_all(worlds, chance)
            worlds.advance(frame * FRAME + scene.step - worlds.time)
            reflex.step()
            for w, memory in enumerate(reflex.memories):
                for part, one in memory.items():
                    own.setdefault((w, part, round(one.started, 6)), one.target)
        begun.append(own)
    together = begun[0].keys() & begun[1].keys()
    first = [float(np.abs(begun[0][one] - begun[1][one]).max()) for one in together]
    return Withdrawals((len(begun[0]), len(begun[1])), len(together), np.array(first))
