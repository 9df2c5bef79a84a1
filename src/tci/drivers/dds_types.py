"""DDS types whose samples TCI encodes itself."""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import IdlStruct


def carry_raw(kind: type[IdlStruct]) -> type[IdlStruct]:
    """Makes cyclonedds send and receive the `raw` bytes of samples, instead of encoding them field by
    field."""

    def serialize(self: Any, *args: Any, **options: Any) -> bytes:
        return bytes(self.raw)

    def deserialize(cls: Any, data: bytes, *args: Any, **options: Any) -> Any:
        sample = cls.__new__(cls)
        sample.raw = data
        return sample

    kind.serialize = serialize  # type: ignore[method-assign]  # on purpose
    kind.deserialize = classmethod(deserialize)  # type: ignore[method-assign, assignment]  # on purpose
    return kind
