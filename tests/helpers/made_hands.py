"""Small models of five kinds of hands for made humanoids.

The arms hang. The left palm faces right, and its thumb is in front. Each joint is given by its name, the step
[m] to the joint, its axis and its limits [rad].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tci.messages.frames import Array

Joint = tuple[str, tuple[float, float, float], tuple[float, float, float], tuple[float, float]]
Chain = Sequence[Joint]
BEND, ASIDE, OPPOSE = (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
"""Joint axes of a left hand that bend the fingers, move them sideways, and oppose the thumb."""
LONG = (-0.1, 1.6)
TURN = (-0.3, 0.3)


def _row(name: str, x: float, turns: Sequence[str], *, spread: tuple[float, float, float] | None) -> Chain:
    """Returns a finger at `x` [m] towards the thumb's side. Its joints are named after it."""
    chain: list[Joint] = []
    at = (x, 0.0, -0.09)
    if spread is not None:
        chain.append((f"{name}{turns[0]}", at, spread, TURN))
        at, turns = (0.0, 0.0, -0.01), turns[1:]
    for turn in turns:
        chain.append((f"{name}{turn}", at, BEND, LONG))
        at = (0.0, 0.0, -0.035)
    return chain


def inspire() -> list[Chain]:
    """Returns a hand with five fingers whose outer joints follow the inner joints."""
    thumb: Chain = [
        ("thumb_proximal_yaw", (0.02, 0.0, -0.03), OPPOSE, (0.0, 1.3)),
        ("thumb_proximal_pitch", (0.02, 0.0, -0.01), ASIDE, (0.0, 0.6)),
        ("thumb_intermediate", (0.03, 0.0, 0.0), ASIDE, (0.0, 0.8)),
    ]
    names = ("index", "middle", "ring", "pinky")
    rows = [
        _row(n, 0.02 - 0.02 * i, ("_proximal", "_intermediate"), spread=None) for i, n in enumerate(names)
    ]
    return [thumb, *rows]


def folding() -> list[Chain]:
    """Returns the same hand with a palm that folds along its length: ring and little finger are on its outer
    part."""
    fold: Joint = ("palm_fold", (-0.01, 0.0, -0.05), (0.0, 0.0, 1.0), (0.0, 0.9))
    thumb, index, middle, *others = inspire()
    folded = []
    for (name, (x, y, z), axis, limits), *rest in others:
        folded.append([fold, (name, (x + 0.01, y, z + 0.05), axis, limits), *rest])
    return [thumb, index, middle, *folded]


def shadow() -> list[Chain]:
    """Returns a hand with five fingers and spread. The little finger has an additional joint in the palm, and
    the thumb has five joints."""
    names = ("FF", "MF", "RF", "LF")
    rows = [_row(n, 0.033 - 0.022 * i, ("J4", "J3", "J2", "J1"), spread=ASIDE) for i, n in enumerate(names)]
    arch: Joint = ("LFJ5", (-0.033, 0.0, -0.02), (0.57, 0.0, -0.82), (0.0, 0.7))
    first = rows[3][0]
    rows[3] = [arch, (first[0], (0.0, 0.0, -0.07), first[2], first[3]), *rows[3][1:]]
    slant = 0.5**0.5
    thumb: Chain = [
        ("THJ5", (0.034, 0.0, -0.029), (slant, 0.0, -slant), (-1.0, 1.0)),
        ("THJ4", (0.0, 0.0, 0.0), (-slant, 0.0, -slant), (0.0, 1.2)),
        ("THJ3", (0.027, 0.0, -0.027), (-slant, 0.0, -slant), TURN),
        ("THJ2", (0.001, 0.0, -0.001), ASIDE, (-0.5, 0.7)),
        ("THJ1", (0.022, 0.0, -0.022), ASIDE, (0.0, 1.5)),
    ]
    return [thumb, *rows]


def allegro() -> list[Chain]:
    """Returns a hand with three fingers and a thumb, whose names do not indicate their function. To spread,
    straight fingers turn about their own axis."""
    rows = [
        _row(f"joint_{4 * i}", 0.04 - 0.04 * i, ("", "_1", "_2", "_3"), spread=(0.0, 0.0, 1.0))
        for i in range(3)
    ]
    thumb: Chain = [
        ("joint_12", (0.01, 0.0, -0.03), OPPOSE, (0.26, 1.4)),
        ("joint_13", (0.02, 0.0, 0.0), (1.0, 0.0, 0.0), (-0.1, 1.1)),
        ("joint_14", (0.02, 0.0, 0.0), ASIDE, (-0.2, 1.6)),
        ("joint_15", (0.04, 0.0, 0.0), ASIDE, (-0.2, 1.7)),
    ]
    return [*rows, thumb]


def dex3() -> list[Chain]:
    """Returns a hand with two fingers and, opposite to the middle between them, a thumb."""
    rows = [
        [(f"hand_{name}_{i}", (x, 0.0, -0.08) if i == 0 else (0.0, 0.0, -0.045), (1.0, 0.0, 0.0), (-1.6, 0.0))
         for i in range(2)]
        for name, x in (("middle", -0.0285), ("index", 0.0285))
    ]  # fmt: skip
    thumb: Chain = [
        ("hand_thumb_0", (0.0, 0.0, -0.026), (0.0, -1.0, 0.0), (-1.05, 1.05)),
        ("hand_thumb_1", (0.0, -0.02, 0.0), (1.0, 0.0, 0.0), (-0.6, 1.05)),
        ("hand_thumb_2", (0.0, -0.046, 0.0), (1.0, 0.0, 0.0), (0.0, 1.75)),
    ]
    return [thumb, *rows]


FOLLOWERS = {
    **{
        f"{finger}_intermediate": (f"{finger}_proximal", 1.1)
        for finger in ("index", "middle", "ring", "pinky")
    },
    "thumb_intermediate": ("thumb_proximal_pitch", 1.3),
}
"""Joints that follow another joint, by a ratio."""


def tips(chains: Sequence[Chain]) -> dict[str, Array]:
    """Returns the end (3,) [m] of each left finger in the frame of its last link: one more step in the
    direction of the last step."""
    found = {}
    for chain in chains:
        step = np.array(chain[-1][1])
        found[chain[-1][0]] = 0.03 * step / np.linalg.norm(step)
    return found


def with_hands(
    path: Path, chains: Sequence[Chain], *, names: Mapping[str, str] | None = None,
    limits: tuple[float, float] | None = None, motor: tuple[float, float] = (2.0, 6.28),
) -> Path:  # fmt: skip
    """Adds a hand to each wrist of a URDF. `names` renames the joints, and `limits`, if given, replaces the
    limits of all joints.

    `motor` is the torque limit [N m] and the speed limit [rad/s] of the joints.
    """
    words, ends, made = [], tips(chains), set()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for chain in chains:
            parent = f"{side}_wrist_pitch_link"
            for name, (x, y, z), (ax, ay, az), own in chain:
                full = f"{side}_{(names or {}).get(name, name)}"
                if full in made:  # a joint that carries several chains
                    parent = f"{full}_link"
                    continue
                made.add(full)
                lower, upper = limits or own
                follows = FOLLOWERS.get(name)
                mimic = f"<mimic joint='{side}_{follows[0]}' multiplier='{follows[1]}'/>" if follows else ""
                words.append(
                    _link(f"{full}_link", ends.get(name, np.zeros(3)) * [1.0, sign, 1.0])
                    + f"<joint name='{full}' type='revolute'><parent link='{parent}'/>"
                    f"<child link='{full}_link'/><origin xyz='{x} {y * sign} {z}'/>"
                    f"<axis xyz='{ax * sign} {ay} {az * sign}'/>{mimic}"
                    f"<limit lower='{lower}' upper='{upper}' effort='{motor[0]}' velocity='{motor[1]}'/>"
                    "</joint>"
                )
                parent = f"{full}_link"
    path.write_text(path.read_text().replace("</robot>", f"{''.join(words)}</robot>"))
    return path


def _link(name: str, end: Array) -> str:
    """Returns a link with a small ball at `end` (3,) [m]."""
    x, y, z = end
    return (
        f"<link name='{name}'><inertial><origin xyz='0 0 0'/><mass value='0.02'/>"
        "<inertia ixx='1e-5' iyy='1e-5' izz='1e-5' ixy='0' ixz='0' iyz='0'/></inertial>"
        f"<collision><origin xyz='{x} {y} {z}'/><geometry><sphere radius='0.004'/></geometry></collision>"
        "</link>"
    )
