"""Reads and writes measured properties of a robot. The properties are in JSON files, in the folder of the
robot's description."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from tci.errors import DescriptionError, Fault, TciError
from tci.robot.description import Description

Measured = TypeVar("Measured", bound=Description)
_LARGEST = 16 * 2**20


def read_json(path: Path, kind: type[Measured]) -> Measured:
    """Returns the measured properties in a JSON file. Raises DescriptionError with all faults of the file."""
    try:
        if path.stat().st_size > _LARGEST:
            raise DescriptionError(str(path), [Fault(0, f"larger than {_LARGEST} bytes")])
        return kind.model_validate_json(path.read_bytes())
    except OSError as error:
        raise DescriptionError(str(path), [Fault(0, f"can't be read: {error.strerror}")]) from None
    except ValidationError as error:
        faults = [
            Fault(0, f"{'.'.join(map(str, one['loc'])) or 'file'}: {one['msg']}") for one in error.errors()
        ]
        raise DescriptionError(str(path), faults) from None


def write_json(path: Path, measured: Description) -> None:
    """Writes measured properties into a JSON file. Raises TciError if the file can't be written."""
    try:
        path.write_text(measured.model_dump_json(indent=1) + "\n")
    except OSError as error:
        raise TciError(f"{path} can't be written: {error.strerror}") from None
