from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic

from tci.errors import RecordingError
from tci.recording.rosmsg.cdr import MessageType, decode, encode

KIND = MessageType(
    "tci_msgs/msg/Test",
    (
        ("bool", "a"), ("string", "b"), ("float64[]", "c"), ("uint16", "d"), ("string[]", "e"),
        ("int64", "f"), ("uint8[]", "g"), ("uint32[]", "h"), ("float64", "i"),
    ),
)  # fmt: skip
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
floats = st.floats(allow_nan=False)
VALUES = st.tuples(
    st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1), texts,
    st.booleans(), texts, st.lists(floats, max_size=4), st.integers(0, 65535), st.lists(texts, max_size=4),
    st.integers(-(2**63), 2**63 - 1), st.lists(st.integers(0, 255), max_size=9),
    st.lists(st.integers(0, 2**32 - 1), max_size=4), floats,
)  # fmt: skip


@given(VALUES)
def test_what_is_written_is_read(values: tuple[object, ...]) -> None:
    found = decode(KIND, encode(KIND, values))
    plain = [v.tolist() if isinstance(v, np.ndarray) else v for v in found.values()]
    assert plain == list(values)


@given(VALUES)
def test_a_foreign_reader_reads_the_same(values: tuple[object, ...]) -> None:
    decoder = generate_dynamic(KIND.name, KIND.definition)[KIND.name]
    message = decoder(encode(KIND, values))
    stamp = message.header.stamp
    assert [stamp.sec, stamp.nanosec, message.header.frame_id] == list(values[:3])
    for (_, name), value in zip(KIND.fields, values[3:], strict=True):
        found = getattr(message, name)
        assert (list(found) if isinstance(value, list) else found) == value


@given(VALUES, st.data())
def test_58_damaged_bytes_are_refused_or_read(values: tuple[object, ...], data: st.DataObject) -> None:
    raw = bytearray(encode(KIND, values))
    for _ in range(3):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    raw = raw[: data.draw(st.integers(0, len(raw)))]
    with suppress(RecordingError):
        decode(KIND, bytes(raw))


def test_31_a_declared_length_is_checked_before_memory_is_taken() -> None:
    kind = MessageType("tci_msgs/msg/Big", (("float64[]", "values"),))
    head = encode(kind, (0, 0, "", []))[:-4]
    for count in (2**31 - 1, 2**32 - 1):
        with pytest.raises(RecordingError, match="declared"):
            decode(kind, head + count.to_bytes(4, "little"))
