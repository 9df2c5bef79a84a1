"""How far a weight in a hand, of which nobody told, bends each joint: so much is no contact."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError, UnknownNameError
from tci.messages.frames import Array, apply, invert, read_only
from tci.robot.description import Robot
from tci.robot.gravity import STANDARD_GRAVITY
from tci.robot.joint_calibration import Tool
from tci.robot.kinematics import KinematicChain

UNDECLARED = 0.3
"""Mass [kg] that a hand may carry without a word: a phone, a small bottle."""
BEYOND = 0.05
"""Distance [m] of its centre from the frame of the hand's last link."""
SOFT = float(np.deg2rad(12.0))
"""Angle [rad] by which a servo's full torque bends it. Assumed: with it, dry friction of 5 % of the torque
leaves half a degree, as good servos do."""
FRICTION = 0.05
"""Dry friction, as a fraction of the torque limit."""
SHAKEN = 1.5
"""Factor by which a weight bends a joint more while its part moves."""
MOST = float(np.deg2rad(4.0))
"""Angle [rad] beyond which a bend is always a contact: at 6 degrees the joint monitor stops the robot."""
SINKS = 1.0
"""Time [s] within which a joint that got softer has sunk: several swings of an arm at a fifth of its
stiffness."""
SETTLES = 0.2
"""The same [s] once its part moves: a servo of 60 rad/s has sunk by 98 % then, and whoever is struck later
holds it."""
WRONG = 0.2
"""Fraction of a weight by which a servo that compensates it may lift its joint: masses are wrong by that."""
POSTURES = 32
ALIKE, COARSE = 0.1, float(np.deg2rad(0.2))
"""Fraction and angle [rad] by which two bends by one weight differ: its lever, and an encoder's steps."""
GAVE = 0.5
"""Fraction of its bend by which a reference must have gone to where the joint was, to tell a weight."""


class Sag:
    """How far weights bend the joints of one group. A weight bends a joint as much after its reference gave
    way; what a person bends it by falls."""

    def __init__(self) -> None:
        self.bent: Array | float = 0.0
        """Angles (k,) [rad] between references and joints that are a weight's doing."""
        self._last: tuple[Array, Array] | None = None

    def look(self, reference: Array, here: Array, most: Array) -> None:
        """Notes where joints rest after a way back (k,) [rad], and where they should be. A weight bends each
        by `most` (k,) [rad] at most."""
        bent, last = reference - here, self._last
        self._last = reference, bent
        if last is not None:
            gave = (last[0] - reference) * np.sign(last[1]) >= GAVE * np.abs(last[1])
            alike = np.abs(bent - last[1]) <= np.maximum(ALIKE * np.abs(bent), COARSE)
            self.bent = np.where(gave & alike & (np.abs(bent) <= most), bent, self.bent)


class Sags:
    """How far the joints of one group sag since they got a smaller share of their stiffness. What a softer
    joint sinks by is no contact, but what bends it further is, and what lifts it."""

    def __init__(self, servos: NDArray[np.intp]) -> None:
        self._servos = servos
        self.shares = np.ones(len(servos))
        """Which they get (k,)."""
        self._sags = np.zeros(len(servos))
        self._stiffer = np.zeros(len(servos), bool)
        self._until = np.full(len(servos), -np.inf)

    @property
    def soft(self) -> bool:
        return bool((self.shares < 1.0).any())

    def told(self, servos: NDArray[np.intp], shares: Array, now: float) -> None:
        """Notes which shares (j,) of their stiffness `servos` (j,) get at `now` [s]."""
        new = self.shares.copy()
        for servo, share in zip(servos.tolist(), shares.tolist(), strict=True):
            new[self._servos == servo] = share
        self._until[new < self.shares], self._until[new > self.shares] = now + SINKS, -np.inf
        self._stiffer = (self._stiffer | (new > self.shares)) & (new >= self.shares)
        self.shares = new

    def share_of(self, servo: int) -> float:
        return float(self.shares[self._servos == servo][0])

    def gets(self, servo: int, share: float, sag: float) -> None:
        """Notes that a servo gets a share of its stiffness at which it sags by `sag` [rad] at most."""
        mine = self._servos == servo
        self.shares[mine], self._sags[mine] = share, sag
        self._until[mine], self._stiffer[mine] = -np.inf, False

    def look(self, behind: Array, weights: Array, now: float, *, moves: bool) -> Array:
        """By how much each joint sags (k,) [rad] that is `behind` its reference by so much (k,) [rad], either
        way, while its group `moves` or not. `weights` (k,) [rad] bend it at full stiffness; 0 if nobody knows
        which way."""
        if moves:
            self._until[now >= self._until - SINKS + SETTLES] = -np.inf
        off, shares = np.abs(behind), np.maximum(self.shares, 1e-3)
        # at a share of its stiffness the same weight bends it further, but no weight bends it as far as MOST
        lifts = behind * weights < 0.0
        least = WRONG * np.abs(weights) / shares
        sunk = np.minimum(off, np.where(lifts, least, MOST / shares))
        self._sags = np.where(now < self._until, np.maximum(self._sags, sunk), self._sags)
        self._sags = np.where(self._stiffer, np.minimum(self._sags, off), self._sags)
        return np.where(lifts, np.minimum(self._sags, least), self._sags)


def bends(robot: Robot, loads: Mapping[str, Tool], *, most: float = MOST) -> Array:
    """Angles (n_servos,) [rad], at `most`, by which dry friction, a weight that nobody declared, and declared
    `loads`, by the name of their links, may bend the joints; 0 where the model or the torque limit is
    unknown."""
    weights = np.zeros(len(robot.servos))
    try:
        levers = _levers(robot)
    except (DescriptionError, UnknownNameError):
        return weights
    for one in levers:
        mass = UNDECLARED + sum(tool.mass for link, tool in loads.items() if link in one.links)
        weights = np.maximum(weights, mass * STANDARD_GRAVITY * np.maximum(one.arm, one.waist))
    torque = np.array([servo.limits.torque or np.inf for servo in robot.servos])
    bent: Array = np.where(weights > 0.0, SOFT * (weights / torque + FRICTION), 0.0)
    return np.minimum(bent, most)


def longest_levers(robot: Robot) -> Array:
    """Longest lever (n_servos,) [m] that a force on an arm's hand has at each joint; 0 where the model is
    unknown."""
    try:
        levers = [one.arm for one in _levers(robot)]
    except (DescriptionError, UnknownNameError):
        levers = []
    return np.array(np.max([np.zeros(len(robot.servos)), *levers], axis=0))


class _Levers(NamedTuple):
    """Longest levers (n_servos,) [m] that a weight in the hand of one arm has."""

    links: frozenset[str]
    """Those of the arm."""
    arm: Array
    waist: Array
    """At joints below the torso, which carry the arm."""


@lru_cache(maxsize=8)
def _levers(robot: Robot) -> tuple[_Levers, ...]:
    chain, random = KinematicChain(robot), np.random.default_rng(0)
    lower = np.array([servo.limits.lower or 0.0 for servo in robot.servos])
    upper = np.array([servo.limits.upper or 0.0 for servo in robot.servos])
    postures = random.uniform(lower, np.maximum(lower, upper), (POSTURES, len(lower)))
    root, found = chain.links[0], list[_Levers]()
    for part in robot.parts:
        own = {one.servo for one in part.servos if one.servo is not None}
        if part.kind != "arm" or not own:
            continue
        moved = {name: {*chain.chain(name)} for name in chain.links}
        link = max(moved, key=lambda name: (len(own & moved[name]), len(moved[name])))
        levers = [np.linalg.norm(chain.jacobian(one, link)[:3], axis=0) for one in postures]
        longest = np.max(levers, axis=0)
        links = frozenset(name for name, servos in moved.items() if own & servos)
        moves = np.isin(np.arange(len(lower)), [*moved[link]])
        carried = [_at_root(chain, one, root, link) for one in postures]
        waist = np.where(
            np.isin(np.arange(len(lower)), [*chain.chain(root)]), np.max(carried, axis=0), -BEYOND
        )
        found.append(
            _Levers(links, read_only(np.where(moves, longest + BEYOND, 0.0)), read_only(waist + BEYOND))
        )
    return tuple(found)


def _at_root(chain: KinematicChain, position: Array, root: str, link: str) -> Array:
    """Levers (n_servos,) [m] of the frame of `link` at the joints between the torso and the root."""
    poses = chain.poses(position, (root, link))
    point = apply(invert(poses[root]), poses[link][:3, 3])
    levers: Array = np.linalg.norm(chain.jacobian(position, root, point=point)[:3], axis=0)
    return levers
