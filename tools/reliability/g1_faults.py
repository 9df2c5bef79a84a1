"""Rehearses faults over the DDS topics of a Unitree G1."""

from __future__ import annotations

from rich.progress import track
from row import Row

from helpers.rehearsed import EXPECTED, Rehearsed, rehearse
from helpers.wire_peers import Unitree

TRIES = 10
"""Number of attempts to rehearse one fault if the machine delays the processes. Assumed: at least one of ten
attempts is in time even if other programs run."""


def unitree_faults(full: bool) -> Row:
    """Rehearses each fault on a served robot whose arms move. Repeats a rehearsal that ends otherwise than
    expected if the loop or the robot got no processor time meanwhile."""
    names = [*EXPECTED] if full else ["dropped-frames", "stall"]
    found: dict[str, Rehearsed] = {}
    again = 0
    peer = Unitree()
    peer.start()
    try:
        for name in track(names, "faults over Unitree's topics"):
            for _ in range(TRIES):
                found[name] = rehearse(peer, name)
                if not (found[name].wrong and found[name].late):
                    break
                again += 1
    finally:
        peer.stop()
    wrong = [f"{name}: {one.wrong}" for name, one in found.items() if one.wrong]
    return Row(
        "faults injected into a G1, over Unitree's topics", len(found), len(EXPECTED), "faults",
        f"{len(found) - len(wrong)} with the expected result; {again} delayed trials repeated "
        f"{'; '.join(wrong)}".strip(),
        "all with the expected result", not wrong,
    )  # fmt: skip
