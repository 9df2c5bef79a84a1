"""Message types of DDS that TCI encodes and decodes without the library cyclonedds."""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct


def carry_raw(kind: type[IdlStruct]) -> type[IdlStruct]:
    """Changes the message type `kind`, and returns it. After this, cyclonedds sends the bytes in the
    attribute `raw` of a message, and stores received bytes in `raw`. cyclonedds does not encode or decode the
    message's members."""

    def serialize(self: Any, *args: Any, **options: Any) -> bytes:
        return bytes(self.raw)

    def deserialize(cls: Any, data: bytes, *args: Any, **options: Any) -> Any:
        sample = cls.__new__(cls)
        sample.raw = data
        return sample

    kind.serialize = serialize  # type: ignore[method-assign]  # on purpose
    kind.deserialize = classmethod(deserialize)  # type: ignore[method-assign, assignment]  # on purpose
    return kind
