"""One commander per robot: whoever holds the lease may write, a second one gets an error.

The lease is a locked file, which the system frees when its process ends, however it ends. It counts
between the processes of one user on one machine, and between threads: the file lies in /tmp/tci-UID,
whatever TMPDIR or XDG_RUNTIME_DIR say. It does not count for other users, other machines, and containers
that have a /tmp of their own. Of a robot that `tci serve` shows, the serving process is the one commander:
those who order from it over YARP and NAOqi are not told apart.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tci.errors import LinkError

FOLDER = "TCI_LEASES"
"""Environment variable: another folder, such as one that containers share."""
VALID = f"valid: a folder of your own; {FOLDER} names another, the same for all who command the robot"


@contextmanager
def lease(name: str) -> Iterator[None]:
    """Hold the lease called `name` inside the block.

    Raises LinkError when somebody holds it already, and for a folder that others may write to.
    """
    folder = _folder()
    path = folder / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.lease"
    with (
        _opened(folder, os.O_RDONLY | os.O_DIRECTORY) as place,
        _opened(path, os.O_RDWR | os.O_CREAT) as handle,
    ):
        # systemd clears old files out of /tmp, but not out of a folder that somebody has locked.
        fcntl.flock(place, fcntl.LOCK_SH)
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


@contextmanager
def _opened(path: Path, flags: int) -> Iterator[int]:
    handle = os.open(path, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        yield handle
    finally:
        os.close(handle)


def _folder() -> Path:
    folder = Path(os.environ.get(FOLDER) or f"/tmp/tci-{os.getuid()}")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise LinkError(f"leases lie in {folder}: {error.strerror}; {VALID}") from error
    if not stat.S_ISDIR(found.st_mode):
        raise LinkError(f"leases lie in {folder}, which is no folder; {VALID}")
    if found.st_uid != os.getuid():
        raise LinkError(f"leases lie in {folder}, which belongs to somebody else; {VALID}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise LinkError(f"leases lie in {folder}, which others may write to; {VALID}")
    return folder
