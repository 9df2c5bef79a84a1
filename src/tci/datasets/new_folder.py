"""The folder of a new data set."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tci.errors import RecordingError


@contextmanager
def new_folder(out: Path) -> Iterator[None]:
    """Makes `out` for who fills it; nothing remains of it after an error.

    Raises RecordingError if it exists or the disk fails.
    """
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise RecordingError(f"{out} exists and is not replaced; valid: a new folder") from None
    except OSError as error:
        raise RecordingError(f"{out}: {error.strerror or error}") from error
    try:
        yield
    except BaseException as error:
        shutil.rmtree(out, ignore_errors=True)
        if isinstance(error, OSError):
            raise RecordingError(f"{out}: {error.strerror or error}") from error
        raise
