"""One message of each kind between TCI processes, also as bytes."""

from __future__ import annotations

import dataclasses

import numpy as np

import tci
from tci.drivers.remote.encoding import (
    frame_bytes,
    orders_bytes,
    state_bytes,
    to_orders,
    to_skin,
    to_state,
)
from tci.drivers.remote.protocol import Commander, Orders, SessionFrame, State
from tci.messages import JointReading, Met, Mode, PlatformCommand, PlatformSwitch, SkinFrame
from tci.reasons import Code, Reason

NAO = tci.load_robot("nao")
COUNT = len(NAO.servos)
JOINTS = JointReading(
    3.5, 70, np.linspace(-1, 1, COUNT), np.zeros(COUNT), np.ones(COUNT),
    (Mode.POSITION, None) * (COUNT // 2), np.arange(COUNT) % 2 == 0,
)  # fmt: skip
STATE = State(
    11,
    12,
    100.25,
    3.5,
    JOINTS,
    "hold",
    Reason(Code.JOINTS_STALE, "why"),
    (Commander(5, "a", 6, 2, Reason(Code.OTHER_COMMANDER, "because")), Commander(7, "b", 1, 0, None)),
    (Met("left_arm", 12.5, "LElbowRoll", 0.05, "retreat"), Met("head", 7.0, None, 0.0, "told")),
)
FRAME = SessionFrame(11, SkinFrame("left_forearm", 3.25, 9, np.arange(240, dtype=np.uint8)))
ORDERS = Orders(
    11, 100.25, 5, "a", 8, None, False, 3,
    (
        PlatformCommand(Mode.POSITION, np.array([2, 3]), np.array([0.5, -0.5]), np.array([1.0, np.inf])),
        PlatformSwitch(np.array([4]), Mode.TORQUE),
    ),
)  # fmt: skip
WHOLE = {"S": state_bytes(NAO, STATE), "F": frame_bytes(NAO, FRAME), "O": orders_bytes(NAO, ORDERS)}
READ = {"S": to_state, "F": to_skin, "O": to_orders}


def plain(value: object) -> object:
    """Converts dataclasses and arrays to tuples, which can be compared."""
    if dataclasses.is_dataclass(value):
        return type(value), tuple(plain(getattr(value, f.name)) for f in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.dtype.kind, tuple(value.tolist())
    return tuple(map(plain, value)) if isinstance(value, tuple) else value
