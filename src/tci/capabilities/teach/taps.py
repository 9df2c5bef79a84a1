"""Taps: short touches, counted until no more of them come."""

from __future__ import annotations

from dataclasses import dataclass, replace

LONGEST = 0.45
"""Length [s] of the longest tap. The average person taps for 0.06 to 0.14 s (kinds of touch), a slow one
three times as long."""
LIFTED = 0.06
"""Time [s] without contact after which a hand is lifted: three frames of skin at 50 Hz."""
SERIES = 0.5
"""Time [s] after the last tap at which a series of taps is over. Taps are 0.12 to 0.4 s apart."""
GRIPPED = 0.6
"""Time [s] of all short touches of a series from which on they are a grip that slips, where that is likelier
than taps. Four taps of the average person take 0.4 s."""
REGRIP = 0.25
"""Time [s] after a hold within which a new touch belongs to it: a hand slips, or takes another grip."""


@dataclass(frozen=True, slots=True)
class Touching:
    """How one limb is touched over time."""

    onset: float | None = None
    """When the present touch began [s]; None without one."""
    felt: float = float("-inf")
    """When it was last felt [s]."""
    held: bool = False
    """The present touch, or the one before, lasts too long for a tap."""
    taps: int = 0
    """Taps of the present series."""
    spent: float = 0.0
    """Time [s] of these taps."""

    def feel(self, touched: bool, now: float, *, grip: bool = False) -> Touching:
        """The state after this instant. `grip`: a grip is likelier here than taps."""
        if touched:
            if self.onset is None:
                held = self.held and now - self.felt < REGRIP
                return replace(self, onset=now, felt=now, held=held, taps=0 if held else self.taps)
            lasts = now - self.onset
            held = self.held or lasts > LONGEST or (grip and self.spent + lasts > GRIPPED)
            return replace(self, felt=now, held=held, taps=0 if held else self.taps)
        if self.onset is not None and now - self.felt > LIFTED:
            spent = self.spent + self.felt - self.onset
            return replace(self, onset=None, taps=self.taps + (not self.held), spent=spent)
        if self.onset is None and now - self.felt > SERIES:
            return Touching(felt=self.felt)
        return self

    @property
    def touched(self) -> bool:
        return self.onset is not None

    def over(self, now: float) -> int:
        """Number of taps of a series that is over in the step at `now` [s]; 0 if none is."""
        return self.taps if self.onset is None and now - self.felt > SERIES else 0
