"""Faults rehearsed over a G1's topics."""

from __future__ import annotations

from rich.progress import track
from row import Row

from drivers.unitree.rehearsed import EXPECTED, rehearse
from drivers.wires import Unitree


def unitree_faults(full: bool) -> Row:
    """Rehearses each fault on a served robot whose arms move."""
    names = [*EXPECTED] if full else ["dropped-frames", "stall"]
    peer = Unitree()
    peer.start()
    try:
        found = {name: rehearse(peer, name) for name in track(names, "faults over Unitree's topics")}
    finally:
        peer.stop()
    wrong = [f"{name}: {why}" for name, why in found.items() if why]
    return Row(
        "faults rehearsed over a G1's topics", len(found), len(EXPECTED), "faults",
        f"{len(found) - len(wrong)} as without a wire {'; '.join(wrong)}".strip(), "all", not wrong,
    )  # fmt: skip
