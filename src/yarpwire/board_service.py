"""Base class of a control board that this process offers to clients. It defines the methods that the calls
and streamed commands of clients need.

Angles are in degrees, velocities in degrees per second, torques in N m. Joints are numbered from 0. As an
argument, None selects all joints.
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
    """Base class of served boards. Arguments come unchecked from clients. Methods raise CallError if an
    argument is wrong, or if the board can't execute the call."""

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
    """Number of answers sent so far that contain a time."""

    @property
    @abstractmethod
    def set_points(self) -> Mapping[Stream, Array]:
        """Set-points (n,) of all joints: positions [deg], velocities [deg/s] and torques [N m]. For a
        joint without a set-point of a quantity, the value is the measured position, or 0 for velocity and
        torque."""

    def awaited(self) -> AbstractContextManager[None]:
        """Returns a context manager for one call. When the context ends, the board has executed the call, or
        CallError is raised."""
        return nullcontext()

    @abstractmethod
    def joints(self, numbers: Joints) -> list[int]:
        """Returns the joints as a list. Raises CallError if a joint does not exist or is named twice."""

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
        """Switches joints to control modes. `words` (k,) are YARP's codes of the modes, such as
        `Vocab("pos")`."""

    @abstractmethod
    def set_interactions(self, joints: Joints, words: Sequence[int]) -> None:
        """Makes joints stiff or compliant. `words` (k,) are the vocabularies STIFF or COMPLIANT."""

    @abstractmethod
    def impedance(self, joint: int) -> Array:
        """Returns an array (2,) with the stiffness [N m/deg] and damping [N m s/deg] of a joint."""

    @abstractmethod
    def impedance_limits(self, joint: int) -> tuple[float, float]:
        """Returns the highest stiffness [N m/deg] and damping [N m s/deg] that are allowed for a joint."""

    @abstractmethod
    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        """Sets stiffness [N m/deg] and damping [N m s/deg] of a joint."""

    @abstractmethod
    def set_speeds(self, joints: Joints, speeds: Sequence[float]) -> None:
        """Sets the speeds (k,) [deg/s] of joints for all later moves."""

    @abstractmethod
    def set_accelerations(self, joints: Joints, values: Sequence[float]) -> None:
        """Sets the accelerations (k,) [deg/s2] of joints for all later moves."""

    @abstractmethod
    def move(self, joints: Joints, angles: Sequence[float], *, relative: bool = False) -> None:
        """Begins a move of joints to angles (k,) [deg], at the speed that `set_speeds` has set. If `relative`
        is True, the angles are relative to the present ones."""

    @abstractmethod
    def is_done(self, joints: Joints) -> bool:
        """Returns True if all moves of these joints have reached their targets."""

    @abstractmethod
    def stream(self, stream: Stream, joints: Joints, numbers: Sequence[float]) -> None:
        """Makes joints follow streamed set-points (k,): angles [deg], velocities [deg/s] or torques [N m]."""

    @abstractmethod
    def stop(self, joints: Joints) -> None:
        """Stops the joints at their present angles."""
