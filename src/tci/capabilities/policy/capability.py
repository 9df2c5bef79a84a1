"""A trained policy as a capability: at its own rate under a faster loop, and held when it is late."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.capabilities.policy.file import read_policy
from tci.capabilities.policy.observations import Observation
from tci.capabilities.policy.spec import Policy, PolicySpec, Seen
from tci.capabilities.policy.worker import Worker
from tci.errors import TciError
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.messages.frames import Array, read_only

STEP = 1e-3
"""Angle [rad] by which a target must differ from the last one to be ordered: less than a servo can do, and
an arm at rest gets no orders."""
ROUNDING = 1e-6
"""Time [s] by which a sum of periods may miss the time that it stands for."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyMemory:
    """What a policy remembers of one part."""

    home: Array
    """Posture (n,) [rad] when it began."""
    due: float
    """Time [s] of the next observation."""
    ask: float = -math.inf
    """Time [s] of the next question."""
    seen: Seen | None = None
    asked: Array | None = None
    """Observations on which it computes."""
    asked_at: float = 0.0
    late: bool = False
    """True if it still computes when its actions should be carried out."""
    actions: Array | None = None
    """The actions (chunk, n) that are carried out."""
    begun: float = 0.0
    """Time [s] of the first of them."""
    used: int = -1
    """Index of the last of them that was used."""
    target: Array | None = None
    """Values (n,) of the last order; at first `home`, and None after others moved the part."""
    wrong: str = ""
    """Why the part is held; empty if it is not."""


Policies = Mapping[str, PolicyMemory]
"""Memory of a policy, by part."""


@dataclass(frozen=True, eq=False)
class PolicyCapability(Capability[Policies]):
    """Runs a trained policy: a file of `write_policy`, or a function.

    The policy acts for each part that it can move alone, also on a robot on which it was not trained. It
    is computed beside the loop. If that takes longer than `PolicySpec.time`, or gives a number that is not
    finite, the part is held where it is until the policy gives actions again. The time counts on the
    computer's clock, so a simulation shows that a policy is too slow for a robot.

    Raises TciError for a file that can't be used, and for a `spec` beside a file that has one.
    """

    policy: str | Path | Policy
    """Path of an ONNX file, or a function from observations to actions. What it gives must depend on the
    observations alone, or replays differ."""
    spec: PolicySpec | None = None
    """What the policy sees and when it acts. None: the file says it."""
    parts: tuple[str, ...] = ()
    """Generic parts that it moves. Empty: all that it can."""
    observations: Mapping[str, Observation] = field(default_factory=dict)
    """Observations of your own, by the name that the spec gives them."""
    goal: tuple[float, ...] = ()
    """What is asked for, for a policy that sees its `goal`, in the unit of its task."""
    _worker: Worker = field(init=False, repr=False)

    def __post_init__(self) -> None:
        policy, spec = self.policy, self.spec
        if isinstance(policy, str | Path):
            if spec is not None:
                raise TciError(f"policy: spec for {policy}, which has its own; valid: none")
            policy, spec = read_policy(policy)
        elif not callable(policy):
            raise TciError(f"policy: {policy!r}; valid: the path of an ONNX file, or a function")
        object.__setattr__(self, "spec", spec or PolicySpec())
        object.__setattr__(self, "_worker", Worker(policy))

    @property
    def _spec(self) -> PolicySpec:
        assert self.spec is not None
        return self.spec

    @property
    def needs(self) -> tuple[Need, ...]:
        felt = any(name in ("contacts", "taxels") for name in self._spec.observations)
        kind = self._spec.kind
        return (Need(f"skin on an {kind}" if felt else f"part {kind}", self.parts or (kind,), skin=felt),)

    def init(self, body: GenericBody) -> Policies:
        """Raises TciError for a robot without a part that the policy can move."""
        self._parts(body)
        return {}

    def _parts(self, body: GenericBody) -> tuple[str, ...]:
        able = self._spec.parts_of(body)
        if wrong := [part for part in self.parts if part not in able]:
            raise TciError(f"policy: it can't move {', '.join(wrong)}; valid: {', '.join(able) or 'no part'}")
        if not able:
            raise TciError(
                f"policy: {body.robot.name} has no {self._spec.kind} with the joints "
                f"{', '.join(self._spec.joints)}; valid: a robot that has one"
            )
        return self.parts or able

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        if Mode.of(self._spec.mode) is Mode.POSITION:
            return ()
        return tuple(SwitchMode(part, self._spec.mode) for part in self._parts(body))

    def step(
        self, memory: Policies, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Policies]:
        orders, after = list[Order](), dict[str, PolicyMemory]()
        for part in memory or self._parts(body):
            now = perception.posture[part]
            own = memory.get(part) or PolicyMemory(now, perception.stamp, target=now)
            own = self._look(own, part, perception, body)
            order, own = self._act(self._give_way(own, part, perception), part, perception)
            orders += [] if order is None else [order]
            after[part] = own
        return tuple(orders), after

    def _look(self, own: PolicyMemory, part: str, perception: Perception, body: GenericBody) -> PolicyMemory:
        """Observes if it is time to, and asks the policy if its actions are done."""
        now, spec = perception.stamp, self._spec
        if now < own.due - ROUNDING:
            return own
        seen = spec.see(
            perception, body, part, home=own.home, before=own.seen, goal=self.goal, own=self.observations
        )
        own = replace(own, seen=seen, due=_next(own.due, 1.0 / spec.rate, now))
        if own.asked is None and now >= own.ask - ROUNDING:
            self._worker.start(seen.history)
            ask = _next(own.ask, spec.chunk / spec.rate, now)
            own = replace(own, asked=seen.history, asked_at=now, ask=ask, late=False)
        return own

    def _give_way(self, own: PolicyMemory, part: str, perception: Perception) -> PolicyMemory:
        """Waits while the robot is held, and until the gate takes orders to the part again."""
        now = perception.stamp
        if perception.held is not None:
            return replace(own, asked=None, ask=now, actions=None, wrong=str(perception.held))
        if all(met.part != part or met.answer in ("told", "expected") for met in perception.met):
            return own
        return replace(own, asked=None, ask=now, actions=None, wrong="it met something, and gives way")

    def _act(
        self, own: PolicyMemory, part: str, perception: Perception
    ) -> tuple[GenericCommand | None, PolicyMemory]:
        now, spec, held = perception.stamp, self._spec, bool(own.wrong)
        if own.asked is not None and now >= own.asked_at + spec.latency - ROUNDING:
            found = self._worker.result(own.asked, spec.time)
            if found is None:
                late = f"policy late: no action within {1e3 * spec.time:g} ms"
                own = replace(own, late=True, wrong=late)
            elif own.late:  # what was felt is too long ago
                own = replace(own, asked=None, ask=now)
            else:
                own = self._take(own, part, found)
        if own.wrong:
            order = None if held else self._hold(part, perception)
            return order, replace(own, actions=None, target=None)
        if own.actions is None:
            return None, own
        index = int((now - own.begun + ROUNDING) * spec.rate)
        if index == own.used or index >= spec.chunk:
            return None, own
        order = spec.order(part, own.actions[index], own.home)
        same = own.target is not None and np.abs(order.values - own.target).max() < STEP
        if same and order.mode is not Mode.VELOCITY:  # a velocity expires
            return None, replace(own, used=index)
        return order, replace(own, used=index, target=order.values)

    def _take(self, own: PolicyMemory, part: str, found: Array) -> PolicyMemory:
        spec = self._spec
        if found.size != spec.chunk * len(spec.joints):
            raise TciError(
                f"policy: {found.size} numbers for {part}; valid: {spec.chunk} actions of {len(spec.joints)} "
                "joints"
            )
        own = replace(own, asked=None)
        if not np.isfinite(found).all():
            return replace(own, wrong="policy gave a number that is not finite")
        actions = read_only(found.reshape(spec.chunk, -1))
        return replace(own, actions=actions, begun=own.asked_at + spec.latency, used=-1, wrong="")

    def _hold(self, part: str, perception: Perception) -> GenericCommand:
        posture, mode = perception.posture[part], Mode.of(self._spec.mode)
        return GenericCommand(part, mode, np.zeros(len(posture)) if mode is Mode.VELOCITY else posture)

    def claims(self, memory: Policies) -> frozenset[str]:
        """All its parts: a policy moves them whenever it wants to."""
        return frozenset(memory)

    def notes(self, memory: Policies) -> tuple[str, ...]:
        return tuple(f"{part} holds: {own.wrong}" for part, own in memory.items() if own.wrong)


def _next(time: float, period: float, now: float) -> float:
    """The instant after `time`, a period later, or a period from now if that is over."""
    return time + period if time + period > now + ROUNDING else now + period
