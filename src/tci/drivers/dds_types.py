"""DDS types whose samples TCI encodes itself."""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct


def carry_raw(kind: type[IdlStruct]) -> type[IdlStruct]:
    """Changes a DDS type so that cyclonedds sends and receives the attribute `raw` (bytes) of a sample,
    instead of encoding and decoding each member."""

    def serialize(self: Any, *args: Any, **options: Any) -> bytes:
        return bytes(self.raw)

    def deserialize(cls: Any, data: bytes, *args: Any, **options: Any) -> Any:
        sample = cls.__new__(cls)
        sample.raw = data
        return sample

    kind.serialize = serialize  # type: ignore[method-assign]  # on purpose
    kind.deserialize = classmethod(deserialize)  # type: ignore[method-assign, assignment]  # on purpose
    return kind
