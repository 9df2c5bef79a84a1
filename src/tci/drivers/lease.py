"""One commander per robot: only the process that holds the robot's lease may write commands.

A second process that requests the lease gets an error. The lease is a lock on a file. The operating system
releases the lock when the process ends, also after a crash. The lease is valid between the processes of one
user on one machine, and between threads. The file is in /tmp/tci-UID. The environment variables TMPDIR and
XDG_RUNTIME_DIR do not change this folder. The lease does not protect against other users, other machines, or
containers with a separate /tmp. For a served robot (`tci serve`), the serving process holds the lease. The
server can't distinguish several clients over YARP or NAOqi, so all these clients can send commands.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tci.errors import DriverError

try:
    import fcntl
except ModuleNotFoundError:  # pragma: no cover - on Windows
    fcntl = None  # type: ignore[assignment]  # the module is missing

FOLDER = "TCI_LEASES"
"""Environment variable with the path of another folder for leases, for example a folder that several
containers share."""
VALID = (
    f"valid: a folder of your own; {FOLDER} names another, the same in every program that commands the robot"
)
_HOLDER = re.compile(rb"process [0-9]{1,10}")


class Lease:
    """The lease of this process on a robot. A forked child process does not inherit the lease. The lease
    remains valid if the lease's file is removed.
    """

    def __init__(self, name: str) -> None:
        """Acquires the lease.

        Raises DriverError if another process holds the lease, or if other users may write to the folder with
        the lease's file. Also raises DriverError if the file can't be locked, or if the system has no file
        locks.
        """
        if fcntl is None:
            raise DriverError(
                f"{name} can't be commanded from this system, which lacks the file locks (flock) that keep "
                "two programs from commanding one robot; valid here: simulated robots and recordings"
            )
        self._name = name
        self._path = _path(name)
        self._owner = os.getpid()
        self._handles: list[int] = []
        self._locked = False
        self._take()

    def check(self) -> None:
        """Checks that this process still holds the lease. Call this method before each write.

        If the lease's file was removed or the file's folder was renamed, acquires the lease again. Raises
        DriverError if another process has acquired the lease, or if this process is a forked child. Also
        raises DriverError in the cases that the constructor lists.
        """
        if os.getpid() != self._owner:
            raise DriverError(
                f"{self._name} is commanded by process {self._owner}, which this one was forked from; "
                "valid: a driver of its own in each process"
            )
        if not self._handles or not _is_at(self._path, self._found):
            self.close()
            self._take()

    def check_inside(self) -> None:
        """Checks a lease that only this process can acquire, because the lease's name contains the number of
        the process. Raises DriverError if another object holds the lease, or if this process is a forked
        child. This method reads the lease's file only if another object in this process has this lease, since
        reading takes 5 % of the computing time of a simulated period.
        """
        if os.getpid() != self._owner or any(
            one is not self and one._path == self._path for one in tuple(_HELD)
        ):
            self.check()

    def close(self) -> None:
        """Releases the lease. A second call has no effect."""
        with _LOCK:
            _HELD.discard(self)
            self._locked = False
            while self._handles:
                os.close(self._handles.pop())

    def _take(self) -> None:
        try:
            while not self._lock():
                self.close()  # the file was removed after it was opened
        except OSError as error:
            self.close()
            raise DriverError(
                f"the lease {self._path}: {error.strerror}; valid: a plain file, or none"
            ) from error
        except BaseException:
            self.close()
            raise

    def _lock(self) -> bool:
        """Locks the lease's file. Returns False if the file was replaced or removed meanwhile. Raises
        DriverError if another process has the lock, or if the file is not a plain file."""
        _make(self._path.parent)
        place = self._opened(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
        handle = self._opened(self._path, os.O_RDWR | os.O_CREAT | os.O_NONBLOCK)
        self._found = os.fstat(handle)
        if not stat.S_ISREG(self._found.st_mode) or self._found.st_nlink > 1:
            raise DriverError(f"the lease {self._path} is no plain file; valid: a plain file, or none")
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            content = os.pread(handle, 64, 0)
            holder = content.decode() if _HOLDER.fullmatch(content) else "another process"
            own = holder == f"process {os.getpid()}"
            advice = "one commander at a time" + "; close the other driver of this program" * own
            raise DriverError(
                f"{self._name} is commanded by {holder}{' (this process)' * own} already; valid: {advice}"
            ) from None
        # The folder is locked because systemd removes old files from /tmp, except from locked folders.
        fcntl.flock(place, fcntl.LOCK_SH)
        if not _is_at(self._path, self._found):
            return False
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()}".encode(), 0)
        self._locked = True
        return True

    def _opened(self, path: Path, flags: int) -> int:
        with _LOCK:
            _HELD.add(self)
            handle = os.open(path, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            self._handles.append(handle)
            return handle


def _is_at(path: Path, found: os.stat_result) -> bool:
    """Returns True if the file at `path` is still the file that `found` describes."""
    try:
        return os.path.samestat(os.lstat(path), found)
    except OSError:
        return False


_HELD: set[Lease] = set()
_LOCK = threading.RLock()
"""Lock that prevents this process from forking while `Lease` opens or closes files."""


def _let_go() -> None:
    """Closes the files of all leases in a forked child process. Otherwise the child process would share the
    locks of the parent process."""
    for held in tuple(_HELD):
        held.close()


if hasattr(os, "register_at_fork"):  # pragma: no branch - not on Windows, where no process forks
    os.register_at_fork(before=_LOCK.acquire, after_in_parent=_LOCK.release, after_in_child=_LOCK.release)
    os.register_at_fork(after_in_child=_let_go)


@contextmanager
def lease(name: str) -> Iterator[Lease]:
    """Acquires the lease `name` at the start of the `with` block and releases it at the end. Raises
    DriverError in the cases that `Lease.__init__` lists."""
    held = Lease(name)
    try:
        yield held
    finally:
        held.close()


def has_locks() -> bool:
    """Returns True if the system has the file locks that a lease needs."""
    return fcntl is not None


def held(name: str) -> Lease | None:
    """Returns the lease `name` if an object in this process holds it."""
    if fcntl is None:
        return None
    path = _path(name)
    return next((one for one in tuple(_HELD) if one._locked and one._path == path), None)


def own_folder() -> Path:
    """The folder of leases, which only this user may write to; made if it is missing. Raises DriverError as
    `Lease` does."""
    folder = _folder()
    _make(folder)
    return folder


def _path(name: str) -> Path:
    return _folder() / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.lease"


def _folder() -> Path:
    folder = Path(os.environ.get(FOLDER) or f"/tmp/tci-{os.getuid()}")
    if not folder.is_absolute():
        raise DriverError(
            f"{FOLDER} is {str(folder)!r}; valid: an absolute path, wherever a program is started"
        )
    return folder


def _make(folder: Path) -> None:
    """Creates the folder for leases if it does not exist. Raises DriverError if the folder belongs to another
    user, or if other users can write to it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise DriverError(f"leases lie in {folder}: {error.strerror}; {VALID}") from error
    if not stat.S_ISDIR(found.st_mode):
        raise DriverError(f"leases lie in {folder}, which is no folder; {VALID}")
    if found.st_uid != os.getuid():
        raise DriverError(f"leases lie in {folder}, which belongs to another user; {VALID}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise DriverError(f"leases lie in {folder}, which others may write to; {VALID}")
