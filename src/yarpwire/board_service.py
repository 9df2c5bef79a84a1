"""A control board that this process offers: the part that the calls and streamed commands of clients need.

Angles in degrees, velocities in degrees per second, torques in N m. Joints are numbers from 0; None is all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext

from yarpwire.board import Stream
from yarpwire.state import BoardState
from yarpwire.values import Array, Vocab

Joints = Sequence[int] | None


class BoardService(ABC):
    """Base class of served boards. Arguments come from the wire unchecked: methods raise CallError for
    wrong ones, and for what can't be done."""

    count: int
    """Number of joints, n."""
    state: BoardState
    """The latest state."""
    stamp: float
    """Time [s] since 1970 at which `state` was measured."""
    speeds: Array
    """Speed (n,) [deg/s] of position moves."""
    accelerations: Array
    """Acceleration (n,) [deg/s2] of position moves."""
    counter = 0
    """Number of answers so far that carry a time."""

    def awaited(self) -> AbstractContextManager[None]:
        """Context of one call. On its exit the board has obeyed, or CallError is raised."""
        return nullcontext()

    @abstractmethod
    def joints(self, numbers: Joints) -> list[int]:
        """Joints as a list, checked: each exists and is named once."""

    @abstractmethod
    def name(self, joint: int) -> str:
        """Name of a joint."""

    @abstractmethod
    def limits(self, joint: int) -> tuple[float, float]:
        """Lowest and highest angle [deg] of a joint."""

    @abstractmethod
    def speed_limit(self, joint: int) -> float:
        """Highest speed [deg/s] of a joint."""

    @abstractmethod
    def torque_limit(self, joint: int) -> float:
        """Largest torque [N m] of a joint, in either direction."""

    @abstractmethod
    def available(self, joint: int) -> list[Vocab]:
        """Control modes that a joint may be switched to."""

    @abstractmethod
    def set_modes(self, joints: Joints, words: Sequence[int]) -> None:
        """Switch to control modes (k,), as vocabularies."""

    @abstractmethod
    def set_interactions(self, joints: Joints, words: Sequence[int]) -> None:
        """Make joints stiff or compliant: STIFF or COMPLIANT (k,), as vocabularies."""

    @abstractmethod
    def impedance(self, joint: int) -> Array:
        """Stiffness [N m/deg] and damping [N m s/deg] of a joint (2,)."""

    @abstractmethod
    def impedance_limits(self) -> tuple[float, float]:
        """Highest stiffness [N m/deg] and damping [N m s/deg] that a joint may be given."""

    @abstractmethod
    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        """Set stiffness [N m/deg] and damping [N m s/deg] of a joint."""

    @abstractmethod
    def set_speeds(self, joints: Joints, speeds: Sequence[float]) -> None:
        """Set the speed (k,) [deg/s] of moves from now on."""

    @abstractmethod
    def set_accelerations(self, joints: Joints, values: Sequence[float]) -> None:
        """Set the acceleration (k,) [deg/s2] of moves from now on."""

    @abstractmethod
    def move(self, joints: Joints, angles: Sequence[float], *, relative: bool = False) -> None:
        """Begin a move to angles (k,) [deg] at the speed that is set."""

    @abstractmethod
    def is_done(self, joints: Joints) -> bool:
        """Whether moves have arrived."""

    @abstractmethod
    def stream(self, stream: Stream, joints: Joints, numbers: Sequence[float]) -> None:
        """Follow streamed set-points (k,): angles [deg], velocities [deg/s] or torques [N m]."""

    @abstractmethod
    def stop(self, joints: Joints) -> None:
        """Stop where the joints are."""
