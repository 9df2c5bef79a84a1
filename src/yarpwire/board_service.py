"""A control board that this process offers: the part that the calls and streamed commands of clients need.

Angles in degrees, velocities in degrees per second, torques in N m. Joints are numbers from 0; None is all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
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

    @property
    @abstractmethod
    def set_points(self) -> Mapping[Stream, Array]:
        """Set-points (n,) that joints follow: target positions [deg] in position modes, velocities [deg/s],
        torques [N m]. The measured position, or 0, of a joint that follows none."""

    def awaited(self) -> AbstractContextManager[None]:
        """Returns the context of one call. On its exit the board has obeyed, or CallError is raised."""
        return nullcontext()

    @abstractmethod
    def joints(self, numbers: Joints) -> list[int]:
        """Returns the joints as a list, checked: each exists and is named once."""

    @abstractmethod
    def name(self, joint: int) -> str:
        """Returns the name of a joint."""

    @abstractmethod
    def limits(self, joint: int) -> tuple[float, float]:
        """Returns the lowest and highest angle [deg] of a joint."""

    @abstractmethod
    def speed_limit(self, joint: int) -> float:
        """Returns the highest speed [deg/s] of a joint."""

    @abstractmethod
    def torque_limit(self, joint: int) -> float:
        """Returns the largest torque [N m] of a joint, in either direction."""

    @abstractmethod
    def available(self, joint: int) -> list[Vocab]:
        """Returns the control modes that a joint may be switched to."""

    @abstractmethod
    def set_modes(self, joints: Joints, words: Sequence[int]) -> None:
        """Switches to control modes (k,), as vocabularies."""

    @abstractmethod
    def set_interactions(self, joints: Joints, words: Sequence[int]) -> None:
        """Makes joints stiff or compliant: STIFF or COMPLIANT (k,), as vocabularies."""

    @abstractmethod
    def impedance(self, joint: int) -> Array:
        """Returns stiffness [N m/deg] and damping [N m s/deg] of a joint (2,)."""

    @abstractmethod
    def impedance_limits(self, joint: int) -> tuple[float, float]:
        """Returns the highest stiffness [N m/deg] and damping [N m s/deg] that a joint may be given."""

    @abstractmethod
    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        """Sets stiffness [N m/deg] and damping [N m s/deg] of a joint."""

    @abstractmethod
    def set_speeds(self, joints: Joints, speeds: Sequence[float]) -> None:
        """Sets the speed (k,) [deg/s] of moves from now on."""

    @abstractmethod
    def set_accelerations(self, joints: Joints, values: Sequence[float]) -> None:
        """Sets the acceleration (k,) [deg/s2] of moves from now on."""

    @abstractmethod
    def move(self, joints: Joints, angles: Sequence[float], *, relative: bool = False) -> None:
        """Begins a move to angles (k,) [deg] at the speed that is set."""

    @abstractmethod
    def is_done(self, joints: Joints) -> bool:
        """Returns True if all moves have arrived."""

    @abstractmethod
    def stream(self, stream: Stream, joints: Joints, numbers: Sequence[float]) -> None:
        """Follows streamed set-points (k,): angles [deg], velocities [deg/s] or torques [N m]."""

    @abstractmethod
    def stop(self, joints: Joints) -> None:
        """Stops the joints where they are."""
