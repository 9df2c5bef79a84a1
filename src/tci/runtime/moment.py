"""What one period of a control loop begins with (`Moment`), and what it has when it is over (`Tick`)."""

from __future__ import annotations

from dataclasses import dataclass

from tci.errors import FrameError
from tci.gate.safe_command import SafeCommand
from tci.messages import Order, Perception, Reading, SkinState


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What a period begins with."""

    now: float
    """Start of the period [s], on the driver's clock."""
    reading: Reading
    perception: Perception | None = None
    """None without a body, and where the frames of the reading do not fit the robot (`misfit`)."""
    took: float = 0.0
    """Time [s] that `Driver.read` took, on the machine's clock."""
    missed: int = 0
    """Periods that were skipped since the previous one."""
    misfit: FrameError | None = None
    """Why the reading gave no perception."""

    def perceived(self) -> Perception:
        """The perception. Raises FrameError if there is none."""
        if self.perception is None:
            raise self.misfit or FrameError("nothing perceives here; valid: Control(driver, body)")
        return self.perception


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """A whole period, for observers."""

    now: float
    """Start of the period [s], on the driver's clock."""
    reading: Reading
    perception: Perception
    """That of the previous tick if the frames of this reading do not fit the robot's description."""
    commands: tuple[Order, ...]
    """Orders that were given in this period, as they came to the gate."""
    sent: SafeCommand
    """What the gate made of them, and the driver sent."""

    @property
    def skin(self) -> SkinState:
        """Pressure on the whole skin, from which the contacts were computed."""
        assert self.perception.skin is not None  # a Perceiver always sets `skin`
        return self.perception.skin
