"""State that a control board publishes at its port `stateExt:o`: a list of 22 items (3.x) or 24 items (4.x).

Each quantity has two items: a list with one value per joint, and the validity of this list (`[ok]` or
`[fail]`). Units are degrees and degrees per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from yarpwire.dialect import V4, Dialect
from yarpwire.errors import WireError
from yarpwire.values import Array, Float32, Vocab

OK, FAIL = Vocab("ok"), Vocab("fail")
JOINTS = ("position", "velocity", "acceleration", "motor_position", "motor_velocity", "motor_acceleration")
QUANTITIES = (*JOINTS, "torque", "duty_cycle", "current", "modes", "interactions", "temperature")
"""Quantities in the order of the message. A board of YARP 3.x sends no temperatures."""
MOST_JOINTS = 256
"""Largest number of joints of a board, to bound the used memory. Assumed: robots have far fewer joints per
board; an iCub has at most 16."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardState:
    """State of the joints of one board. A quantity is None if the board does not measure it."""

    position: Array
    """Angles (n,) [deg]."""
    velocity: Array | None = None
    """Velocities (n,) [deg/s]."""
    torque: Array | None = None
    """Torques (n,) [N m]."""
    modes: tuple[int, ...] | None = None
    """Control mode (n,) of each joint, such as `Vocab("pos")`."""
    interactions: tuple[int, ...] | None = None
    """Interaction mode (n,) of each joint, as vocabularies."""


def encode_state(state: BoardState, dialect: Dialect) -> list[Any]:
    """Returns the items of the Bottle that contains a state."""
    count = len(state.position)
    known = {"position": state.position, "velocity": state.velocity, "torque": state.torque}
    words = {"modes": state.modes, "interactions": state.interactions}
    items: list[Any] = []
    for quantity in QUANTITIES[: _pairs(dialect)]:
        value: Any = known.get(quantity)
        values: list[Any] = [0.0] * count if value is None else [float(number) for number in value]
        if quantity in words:
            value = words[quantity]
            values = [int(word) for word in value or [0] * count]
        elif quantity == "temperature" or (quantity == "duty_cycle" and dialect is V4):
            values = [Float32(0.0)] * count
        items += [values, FAIL if value is None else OK]
    return items


def decode_state(items: Sequence[Any], dialect: Dialect) -> BoardState:
    """Returns the state in a Bottle. Raises WireError if an item is invalid; the error names the item."""
    pairs = _pairs(dialect)
    if len(items) != 2 * pairs:
        raise WireError(f"a state of {len(items)} items; valid for YARP {dialect.name}: {2 * pairs}")
    found: dict[str, Any] = {}
    count = len(items[0]) if isinstance(items[0], list) else 0
    if not 0 < count <= MOST_JOINTS:
        raise WireError(f"a state of {count} joints; valid: 1 to {MOST_JOINTS}")
    for quantity, values, valid in zip(QUANTITIES, items[::2], items[1::2], strict=False):
        if valid != OK:
            continue
        kind = int if quantity in ("modes", "interactions") else float
        if (
            not isinstance(values, list)
            or len(values) != count
            or not all(isinstance(v, kind) for v in values)
        ):
            raise WireError(f"{quantity} of a state: {str(values)[:60]}; valid: {count} of {kind.__name__}")
        found[quantity] = values
    if "position" not in found:
        raise WireError("a state without valid positions")
    return BoardState(
        position=np.array(found["position"]),
        velocity=np.array(found["velocity"]) if "velocity" in found else None,
        torque=np.array(found["torque"]) if "torque" in found else None,
        modes=tuple(Vocab(word) for word in found["modes"]) if "modes" in found else None,
        interactions=tuple(found["interactions"]) if "interactions" in found else None,
    )


def _pairs(dialect: Dialect) -> int:
    return len(QUANTITIES) if dialect is V4 else len(QUANTITIES) - 1
