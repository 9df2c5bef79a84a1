"""How the taxels of a hand rested in the last session: a pad that was pressed while the hand was switched on
took that for rest, or shows it as a touch that never ends."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level

SHARE = 0.05
"""A taxel rests elsewhere from this share of its largest value: warming up moves it by less. Assumed."""
FORGETS = "if that is how it rests now, delete {path}"


def rest_file(name: str) -> Path:
    """Where the rest of the source `name` is kept."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "tci" / "hands" / f"{re.sub(r'[^A-Za-z0-9.=-]+', '_', name)}.json"


def compare_rest(
    path: Path, rest: Mapping[str, NDArray[np.float64]], least: Mapping[str, float]
) -> Iterator[Finding]:
    """Compares with the last session, and keeps this one for the next if nothing differs.

    Args:
        path: The file of the last session.
        rest: Median (values,) of each pad, untouched.
        least: Difference [counts] from which a taxel of each pad rests elsewhere.
    """
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        date, before = str(kept["date"]), {pad: np.array(kept["rest"][pad], float) for pad in kept["rest"]}
    except (OSError, ValueError, KeyError, TypeError):
        date, before = "", {}
    moved = False
    for pad, now in rest.items():
        then = before.get(pad)
        if then is None or then.shape != now.shape:
            continue
        elsewhere = np.nan_to_num(np.abs(now - then)) > least[pad]
        if elsewhere.any():
            moved = True
            largest = (now - then)[elsewhere][np.abs((now - then)[elsewhere]).argmax()]
            said = (
                f"{int(elsewhere.sum())} of {now.size} taxels rest elsewhere than on {date}, by up to "
                f"{largest:+.0f} counts: something touches it, or did while it was switched on"
            )
            advice = f"free it, switch the hand off and on; {FORGETS.format(path=path)}"
            yield Finding(Level.WARNING, pad, said, advice)
    if not moved:
        path.parent.mkdir(parents=True, exist_ok=True)
        rested = {pad: [float(one) if np.isfinite(one) else None for one in now] for pad, now in rest.items()}
        path.write_text(json.dumps({"date": time.strftime("%Y-%m-%d"), "rest": rested}), encoding="utf-8")
