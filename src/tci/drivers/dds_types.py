"""Types of DDS whose samples TCI packs itself."""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct


def carry_raw(kind: type[IdlStruct]) -> type[IdlStruct]:
    """Replaces cyclonedds' methods, which would pack field by field: a sample's `raw` bytes are sent and
    received."""

    def serialize(self: Any, *args: Any, **options: Any) -> bytes:
        return bytes(self.raw)

    def deserialize(cls: Any, data: bytes, *args: Any, **options: Any) -> Any:
        sample = cls.__new__(cls)
        sample.raw = data
        return sample

    kind.serialize = serialize  # type: ignore[method-assign]
    kind.deserialize = classmethod(deserialize)  # type: ignore[method-assign, assignment]
    return kind
