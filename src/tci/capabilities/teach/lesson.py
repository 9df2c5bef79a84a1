"""What is remembered of a lesson while it is given."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from tci.capabilities.teach.motion import SAMPLE, Motion
from tci.messages.frames import Array

PAUSE = 0.3
"""Time [s] of a pause that is kept: while nobody holds it, the lesson's time stands."""
LONGEST = 120.0
"""Longest lesson [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """Postures that were led."""

    clock: float = 0.0
    """Time [s] of the lesson, without pauses."""
    mark: float = 0.0
    """When a part was held last [s]; what comes after it were taps."""
    times: tuple[float, ...] = ()
    """[s]"""
    postures: tuple[Mapping[str, Array], ...] = ()
    """Angles [rad] of all limbs at these times."""
    taught: frozenset[str] = field(default_factory=frozenset)
    """Limbs that were held, longer than for a tap."""

    def watch(
        self, posture: Mapping[str, Array], limbs: Iterable[str], held: frozenset[str], elapsed: float, *,
        touched: bool,
    ) -> Lesson:  # fmt: skip
        """The lesson after this instant.

        Args:
            posture: generic angles [rad] of all parts.
            limbs: what may be taught.
            held: what is held now.
            elapsed: [s].
            touched: somebody touches a limb, or did a moment ago.
        """
        if not touched or self.full:
            return self
        clock, times, postures = self.clock + elapsed, self.times, self.postures
        if not times or clock - times[-1] >= SAMPLE - 1e-9:
            times, postures = (*times, clock), (*postures, {name: posture[name] for name in limbs})
        mark = clock if held else self.mark
        return replace(
            self, clock=clock, mark=mark, times=times, postures=postures, taught=self.taught | held
        )

    @property
    def full(self) -> bool:
        return self.clock > LONGEST

    def motion(self) -> Motion:
        """What was taught. Raises TciError for too short a lesson."""
        kept = [k for k, time in enumerate(self.times) if time <= self.mark]
        return Motion.of(
            [self.times[k] for k in kept],
            {part: [self.postures[k][part] for k in kept] for part in sorted(self.taught)},
        )
