"""What a reader of a published topic gets: 16 values that the publishers of `helpers` count up."""

from __future__ import annotations

import time

import numpy as np

from tci.drivers.diagnosis import Level
from tci.drivers.source_reader import SourceReader


def judge_values(reader: SourceReader, topic: str, *, lost: tuple[int, ...], says: str) -> None:
    """Checks five frames of the patch `pad`, their stamps, and what the doctor says of the topic.

    Args:
        reader: Reads the topic.
        topic: Its whole name.
        lost: Taxels that the publisher leaves out: -1 and NaN are no value.
        says: Words that the doctor's finding must contain.
    """
    state, seen = reader.pads["pad"], list[np.ndarray]()
    end = time.monotonic() + 10.0
    while len(seen) < 5 and time.monotonic() < end:
        if state.values is not None and (not seen or state.values is not seen[-1]):
            seen.append(state.values)
        time.sleep(0.002)
    assert len(seen) == 5, reader.rejected
    for values in seen:
        wanted = (np.arange(16) * 7 + values[0]) % 200.0
        wanted[list(lost)] = np.nan
        np.testing.assert_array_equal(values, wanted)
    assert len({float(values[0]) for values in seen}) > 1, "new values arrive"
    assert abs(state.stamp - time.monotonic()) < 1.0, "on this machine's clock, with and without a header"
    assert not reader.rejected
    (told,) = (one for one in reader.diagnose() if one.subject == topic)
    assert told.level is Level.OK
    assert says in told.what
