"""One commander per robot: whoever holds the lease may write, a second one gets an error.

The lease is a locked file, which the system frees when its process ends, however it ends. It counts
between the processes of one user on one machine, and between threads.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tci.errors import LinkError


@contextmanager
def lease(name: str) -> Iterator[None]:
    """Hold the lease called `name` inside the block. Raises LinkError when somebody holds it already."""
    path = _folder() / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.lease"
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 64).decode(errors="replace") or "another process"
            raise LinkError(
                f"{name} is commanded by {holder} already; valid: one commander at a time"
            ) from None
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()}".encode(), 0)
        yield
    finally:
        os.close(handle)


def _folder() -> Path:
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "tci" if base else Path(tempfile.gettempdir()) / f"tci-{os.getuid()}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise LinkError(f"{folder} belongs to somebody else; set XDG_RUNTIME_DIR to a folder of your own")
    return folder
