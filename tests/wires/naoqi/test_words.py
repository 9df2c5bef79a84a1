"""Encoding of skin frames as text."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.errors import FrameError
from tci.wires.naoqi.words import LONGEST, pack, unpack


@pytest.mark.parametrize("kind", [np.uint8, np.int32, np.float32])
def test_a_frame_comes_back_as_it_was(kind: type) -> None:
    values = np.arange(240).astype(kind)
    sequence, back = unpack(pack(1234, values), 240)
    assert sequence == 1234
    assert back.dtype == values.dtype
    np.testing.assert_array_equal(back, values)


def test_other_numbers_become_those_that_hold_them() -> None:
    assert unpack(pack(0, np.array([1.5, -2.0])), 2)[1].tolist() == [1.5, -2.0]
    assert unpack(pack(0, np.array([70000, -1])), 2)[1].tolist() == [70000, -1]


@pytest.mark.parametrize(
    "text",
    ["", "1", "1 u1", "1 u1 AAAA", "x u1 AAAA", "-1 u1 AAAA", "1 u2 AAAA", "1 u1 AA", "1 u1 A===",
     "1  u1 AA==", "1 u1 AAA=\n", "1 f4 AAA=", "9" * 30 + " u1 AAA=", "1 u1 " + "A" * LONGEST],
)  # fmt: skip
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(FrameError):
        unpack(text, 2)


@given(st.text(max_size=60), st.integers(1, 1000))
def test_no_text_is_taken_for_a_frame_of_another_length(text: str, channels: int) -> None:
    try:
        _, values = unpack(text, channels)
    except FrameError:
        return
    assert values.shape == (channels,)
