"""Fault injectors by name: one class per fault."""

from __future__ import annotations

from tci.lab.faults.injectors.arrivals import (
    ConnectionLost,
    Dropped,
    Duplicates,
    Frozen,
    OutOfOrder,
    SkinSilent,
)
from tci.lab.faults.injectors.injector import Injector
from tci.lab.faults.injectors.joints import (
    EncoderStep,
    ModeMismatch,
    NaNAngle,
    ServoOff,
    StaleEncoder,
    Stall,
    WrongDirection,
)
from tci.lab.faults.injectors.process import THREAD, ClockJump, Overrun, Terminated, ThreadFails
from tci.lab.faults.injectors.taxels import (
    BaselineStep,
    DeadPatch,
    NaNTaxel,
    Saturated,
    StuckHigh,
    StuckLow,
    WrongCount,
    WrongType,
)

__all__ = ["INJECTORS", "THREAD", "Injector"]

INJECTORS: dict[str, type[Injector]] = {
    "taxel-stuck-high": StuckHigh,
    "taxel-stuck-low": StuckLow,
    "dead-patch": DeadPatch,
    "nan-taxel": NaNTaxel,
    "saturated-taxel": Saturated,
    "baseline-step": BaselineStep,
    "wrong-taxel-count": WrongCount,
    "wrong-type": WrongType,
    "dropped-frames": Dropped,
    "skin-silent": SkinSilent,
    "out-of-order": OutOfOrder,
    "duplicates": Duplicates,
    "frozen-source": Frozen,
    "wrong-direction": WrongDirection,
    "stale-encoder": StaleEncoder,
    "stall": Stall,
    "encoder-step": EncoderStep,
    "servo-off": ServoOff,
    "mode-mismatch": ModeMismatch,
    "nan-angle": NaNAngle,
    "clock-jump": ClockJump,
    "overrun": Overrun,
    "sigterm": Terminated,
    "thread-fails": ThreadFails,
    "link-lost": ConnectionLost,
}
"""The class of each fault injector, by the fault's name."""
