"""What a policy sees, what its actions mean, and when it acts: all that its file says beside its network."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.capabilities.policy.observations import OBSERVATIONS, Observation, View
from tci.errors import TciError, UnknownNameError
from tci.messages import GenericCommand, Mode, Perception
from tci.messages.frames import Array, read_only
from tci.robot.generic_arm import JOINTS

Policy = Callable[[Array], ArrayLike]
"""From observations (history x k,), normalised, the oldest first, to actions (chunk x n,) or (chunk, n)."""

MODES = (Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE)
CLIP = 10.0
"""Largest normalised observation: a policy was trained on values of about 1, and knows nothing of others."""
SLOWEST = 20.0
"""Least rate [1/s] in velocity mode: the gate ends a velocity 0.1 s after the last order, and the policy may
miss one."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What a policy saw of one part until now."""

    history: Array
    """The latest observations (history, k), normalised, the oldest first."""
    posture: Array
    """Posture (n,) [rad] in the last of them."""
    stamp: float
    """Time [s] of the last of them."""


@dataclass(frozen=True)
class PolicySpec:
    """What a policy sees, what its actions mean, and when it acts.

    A policy maps observations (history x k,), normalised, the oldest first, to `chunk` actions (chunk x n,),
    one after the other. Raises TciError for a value out of range.
    """

    observations: tuple[str, ...] = ("offset", "velocity", "contacts")
    """Names of what it sees, in this order: of `OBSERVATIONS`, or of your own."""
    kind: str = "arm"
    """Kind of the generic parts that it moves."""
    joints: tuple[str, ...] = JOINTS
    """Names of the n generic joints that its actions move."""
    mode: Literal["position", "velocity", "impedance"] = "position"
    """Control mode of its actions."""
    relative: bool = True
    """True if angles count from the posture in which the part was when the policy began, so that robots with
    another initial posture are moved alike. Without a meaning for velocities."""
    rate: float = 50.0
    """Actions per second. The loop may be faster."""
    history: int = 1
    """Number of observations, 1 / `rate` apart, that it sees at once. Before the first, the first counts."""
    chunk: int = 1
    """Number of actions that it gives at once. It is asked again when they are done."""
    latency: float = 0.0
    """Time [s] from an observation until its first action is carried out. The policy has this long; with 0 it
    is waited for within the loop's period, so it must be quick."""
    mean: tuple[float, ...] = ()
    """Values (k,) of the observations that count as 0. Empty: 0."""
    scale: tuple[float, ...] = ()
    """Distances (k,) from `mean` that count as 1. Empty: those of the observations."""
    action_mean: tuple[float, ...] = ()
    """Angles [rad] or velocities [rad/s] (n,) of an action of 0. Empty: 0."""
    action_scale: tuple[float, ...] = ()
    """Angles or velocities (n,) by which an action of 1 differs from one of 0. Empty: 1 rad or rad/s."""
    limit: float = 1.0
    """Larger actions, before they are scaled, are clipped to this."""

    def __post_init__(self) -> None:
        for name in ("observations", "joints", "mean", "scale", "action_mean", "action_scale"):
            given = getattr(self, name)
            if isinstance(given, str):
                raise TciError(f"policy: {name} {given!r}; valid: a tuple")
            number = name not in ("observations", "joints")
            object.__setattr__(self, name, tuple(map(float, given) if number else given))
        valid = [mode.value for mode in MODES]
        if self.mode not in valid:
            raise TciError(f"policy: mode {self.mode!r}; valid: {', '.join(valid)}")
        least = SLOWEST if self.mode == "velocity" else 0.0
        if not max(least, 1e-3) <= self.rate < math.inf:
            raise TciError(f"policy: rate {self.rate} 1/s; valid: at least {max(least, 1e-3):g}, finite")
        for name in ("history", "chunk"):
            if not getattr(self, name) >= 1:
                raise TciError(f"policy: {name} {getattr(self, name)}; valid: 1 or more")
        if not 0.0 <= self.latency < math.inf or not 0.0 < self.limit < math.inf:
            raise TciError(
                f"policy: latency {self.latency} s, limit {self.limit}; valid: 0 or more, above 0; finite"
            )
        for name in ("mean", "scale", "action_mean", "action_scale"):
            given = np.array(getattr(self, name))
            own = len(given) in (0, len(self.joints)) or not name.startswith("action")
            if not (own and np.isfinite(given).all() and (not name.endswith("scale") or (given > 0.0).all())):
                raise TciError(f"policy: {name} {given.tolist()}; valid: finite, scales above 0, one each")

    @property
    def time(self) -> float:
        """Time [s] that the policy has to compute its actions."""
        return self.latency or self.chunk / self.rate

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str, where: str = "policy") -> PolicySpec:
        """Raises TciError, which names `where`, for anything that `to_json` has not written."""
        try:
            given: dict[str, Any] = json.loads(text)
            if unknown := set(given) - {one.name for one in fields(cls)}:
                raise TciError(f"unknown {', '.join(sorted(unknown))}")
            return cls(**given)
        except (ValueError, TypeError, TciError) as error:
            raise TciError(f"{where}: its description can't be read: {error}") from error

    def with_scales(self, size: Mapping[str, int], own: Mapping[str, Observation]) -> PolicySpec:
        """With the means and scales that it uses written out. `size` has the number of values of each
        observation."""
        known = {**OBSERVATIONS, **own}
        scale = np.concatenate([np.resize(known[name].scale, size[name]) for name in self.observations])
        for name in ("mean", "scale"):
            if (given := len(getattr(self, name))) not in (0, len(scale)):
                raise TciError(
                    f"policy: {name} of {given} values; valid: {len(scale)} here, "
                    + ", ".join(f"{name} {size[name]}" for name in self.observations)
                )
        n = len(self.joints)
        return replace(
            self, mean=self.mean or (0.0,) * len(scale), scale=self.scale or tuple(scale.tolist()),
            action_mean=self.action_mean or (0.0,) * n, action_scale=self.action_scale or (1.0,) * n,
        )  # fmt: skip

    def see(
        self,
        perception: Perception,
        body: GenericBody,
        part: str,
        *,
        home: ArrayLike,
        before: Seen | None = None,
        goal: ArrayLike = (),
        own: Mapping[str, Observation] | None = None,
    ) -> Seen:
        """What the policy sees now of a part, after what it saw `before`.

        Args:
            perception: What is felt now.
            body: The robot's body.
            part: Name of the generic part.
            home: Posture (n,) [rad] of the part when the policy began.
            before: What it saw before; None at first.
            goal: What is asked for (g,), in the unit of the task.
            own: Observations beside those of `OBSERVATIONS`, by name.

        Raises UnknownNameError for an unknown observation, TciError if their number does not fit.
        """
        known = {**OBSERVATIONS, **(own or {})}
        now = perception.posture[part]
        last, elapsed = (now, 0.0) if before is None else (before.posture, perception.stamp - before.stamp)
        begun, wanted = np.asarray(home, np.float64), np.asarray(goal, np.float64)
        view = View(perception, body, part, begun, last, elapsed, wanted)
        found: dict[str, Array] = {}
        for name in self.observations:
            if name not in known:
                raise UnknownNameError("observation", name, known)
            found[name] = np.ravel(known[name].see(view)).astype(np.float64)
        values = np.concatenate([*found.values()])
        spec = self
        if not len(self.mean) == len(self.scale) == len(values):
            spec = self.with_scales({name: len(one) for name, one in found.items()}, own or {})
        row = np.clip((values - spec.mean) / spec.scale, -CLIP, CLIP)
        rows = [row] * self.history if before is None else [*before.history[1:], row]
        return Seen(read_only(np.stack(rows)), now, perception.stamp)

    def order(self, part: str, action: ArrayLike, home: ArrayLike) -> GenericCommand:
        """What one action (n,) asks of a part that began at `home` (n,) [rad]."""
        values = np.clip(np.asarray(action, np.float64), -self.limit, self.limit)
        values = values * (self.action_scale or 1.0) + (self.action_mean or 0.0)
        mode = Mode.of(self.mode)
        if self.relative and mode is not Mode.VELOCITY:
            values = values + np.asarray(home)
        return GenericCommand(part, mode, read_only(values))

    def parts_of(self, body: GenericBody) -> tuple[str, ...]:
        """Parts of a robot that the policy can move: of its kind, with its joints."""
        return tuple(
            part.name
            for part in body.robot.parts
            if part.kind == self.kind
            and tuple(servo.name for servo in part.servos) == self.joints
            and body.has_joint(part.name).any()
        )
