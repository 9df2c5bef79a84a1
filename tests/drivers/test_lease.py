"""Two commanders of one robot, and every manipulation of the lease file, which names the present
commander."""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import tci
from tci.drivers.driver import Driver
from tci.drivers.lease import _let_go, lease
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import DriverError

NAME = "the robot of these tests"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Returns a folder for the leases of one test."""
    folder = tmp_path / "leases"
    monkeypatch.setenv("TCI_LEASES", str(folder))
    return folder


def file_in(folder: Path) -> Path:
    """Returns the file of the only lease in the folder."""
    (file,) = folder.iterdir()
    return file


def refused(words: str) -> None:
    with pytest.raises(DriverError, match=words), lease(NAME):
        pytest.fail("the lease was given")


@pytest.fixture
def forked() -> Iterator[Callable[[Callable[[], None]], int]]:
    """Yields a function that forks a child process, which runs a function and then waits. The child is killed
    at the end."""
    children: list[int] = []

    def fork(act: Callable[[], None]) -> int:
        child = os.fork()
        if child == 0:  # the child process must not execute code of pytest
            try:
                act()
                time.sleep(60.0)
            finally:
                os._exit(1)
        children.append(child)
        return child

    yield fork
    for child in children:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def test_26_a_forked_child_does_not_keep_the_lease_of_its_killed_parent(
    folder: Path, forked: Callable[[Callable[[], None]], int]
) -> None:
    read_end, write_end = os.pipe()

    def command_and_fork() -> None:
        with lease(NAME):
            if os.fork() == 0:
                os.write(write_end, b"%d" % os.getpid())
                time.sleep(60.0)
                os._exit(0)
            time.sleep(60.0)

    parent = forked(command_and_fork)
    child = int(os.read(read_end, 20))
    try:
        refused(f"commanded by process {parent} already")
        os.kill(parent, signal.SIGKILL)
        os.waitid(os.P_PID, parent, os.WEXITED | os.WNOWAIT)
        with lease(NAME):
            os.kill(child, 0)  # the child is still alive
    finally:
        os.kill(child, signal.SIGKILL)


def test_26_a_forked_child_does_not_command_beside_its_parent(folder: Path) -> None:
    driver = SimulatedDriver(tci.load_robot("nao"))

    def write() -> None:
        send(driver.gate.step((), driver.read().joints, driver.clock.now()))

    read_end, write_end = os.pipe()
    with driver.commanding() as send:
        child = os.fork()
        if child == 0:
            try:
                write()
            except DriverError as error:
                os.write(write_end, str(error).encode())
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        os.close(write_end)
        with os.fdopen(read_end) as said:
            assert f"process {os.getpid()}, which this one was forked from; valid: a driver" in said.read()
        write()
        taken = pytest.raises(DriverError, match=f"commanded by process {os.getpid()}")
        with taken, lease(driver.info.lease_name):
            pytest.fail("the child's end gave the lease away")


def test_26_a_process_that_is_not_the_owner_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with lease(NAME) as held:
        with monkeypatch.context() as patch:
            patch.setattr("os.getpid", lambda: 1)
            with pytest.raises(
                DriverError,
                match=r"which this one was forked from; valid: a driver of its own in each process$",
            ):
                held.check()
        held.check()


def test_26_without_file_locks_nothing_is_commanded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tci.drivers.lease.fcntl", None)
    refused(
        rf"^{NAME} can't be commanded from this system, which lacks the file locks \(flock\) that keep "
        "two programs from commanding one robot; valid here: simulated robots and recordings$"
    )
    driver = SimulatedDriver(tci.load_robot("nao"))
    with driver.commanding() as write:
        write(driver.gate.step((), driver.read().joints, driver.clock.now()))


@pytest.mark.parametrize("make", [
    lambda path, other: path.symlink_to(other),
    lambda path, other: os.mkfifo(path),
    lambda path, other: path.mkdir(),
    lambda path, other: (other.write_text("a letter"), path.hardlink_to(other)),
])  # fmt: skip
def test_26_a_lease_file_that_is_none_is_refused_in_words(
    make: Callable[[Path, Path], object], folder: Path, tmp_path: Path
) -> None:
    with lease(NAME):
        file = file_in(folder)
    file.unlink()
    make(file, tmp_path / "elsewhere")
    refused(f"the lease {file}.*; valid: a plain file, or none")
    elsewhere = tmp_path / "elsewhere"
    assert not elsewhere.exists() or elsewhere.read_text() == "a letter"


@pytest.mark.parametrize("whole_folder", [False, True])
def test_26_a_lease_whose_file_is_taken_away_stays_with_its_holder(folder: Path, whole_folder: bool) -> None:
    with lease(NAME) as held:
        if whole_folder:
            folder.rename(folder.with_name("elsewhere"))
        else:
            file_in(folder).unlink()
        held.check()
        refused(rf"commanded by process {os.getpid()} \(this process\) already")
    with lease(NAME):
        pass


@pytest.mark.parametrize("whole_folder", [False, True])
def test_26_who_is_quicker_than_the_holder_of_a_removed_file_commands_alone(
    folder: Path, whole_folder: bool
) -> None:
    driver = SimulatedDriver(tci.load_robot("nao"))
    with driver.commanding() as write:
        safe = write(driver.gate.step((), driver.read().joints, driver.clock.now()))
        if whole_folder:
            folder.rename(folder.with_name("elsewhere"))
        else:
            file_in(folder).unlink()
        with lease(driver.info.lease_name) as second:
            for _ in range(2):
                safe = driver.gate.step((), driver.read().joints, driver.clock.now())
                with pytest.raises(
                    DriverError, match=rf"commanded by process {os.getpid()} \(this process\) already"
                ):
                    write(safe)
            second.check()


def test_26_a_lease_that_is_removed_while_it_is_taken_is_taken_anew(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, removed = fcntl.flock, []

    def remove_first(handle: int, how: int) -> None:
        if not removed:
            removed.append(file_in(folder))
            removed[0].unlink()
        lock(handle, how)

    monkeypatch.setattr(fcntl, "flock", remove_first)
    with lease(NAME):
        assert file_in(folder) == removed[0]
        refused(rf"commanded by process {os.getpid()} \(this process\) already")


def test_26_an_interrupted_start_leaves_no_lease(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(os, "ftruncate", interrupt)
        with pytest.raises(KeyboardInterrupt), lease(NAME):
            pytest.fail("the lease was given")
    with lease(NAME):
        pass


def test_26_what_a_forked_child_lets_go_is_all_of_a_lease(folder: Path) -> None:
    before = set(os.listdir("/proc/self/fd"))
    with lease(NAME):
        _let_go()
        assert set(os.listdir("/proc/self/fd")) == before
        with lease(NAME):
            pass


@pytest.mark.parametrize("said", [b"\x1b[2J\x1b]0;owned\x07", "process \u0661".encode(), b"process 1\n", b""])
def test_26_a_holder_is_named_by_its_number_and_by_nothing_else_that_stands_there(
    folder: Path, said: bytes
) -> None:
    with lease(NAME):
        file_in(folder).write_bytes(said)
        refused("commanded by another process already")


@pytest.mark.parametrize("value", ["leases", "./leases", "~/leases", "../leases"])
def test_26_a_folder_that_differs_by_where_one_stands_is_refused(
    value: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TCI_LEASES", value)
    refused("TCI_LEASES is .*; valid: an absolute path")
    assert not list(tmp_path.iterdir())


def test_26_the_lease_of_a_simulation_is_checked_without_its_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, looks = SimulatedDriver(tci.load_robot("nao")), []
    look = os.lstat

    def counted(path: Path) -> os.stat_result:
        looks.append(path)
        return look(path)

    with driver.commanding() as write:
        monkeypatch.setattr("os.lstat", counted)
        for _ in range(3):
            write(driver.gate.step((), driver.read().joints, driver.clock.now()))
        monkeypatch.undo()
    assert not looks


def test_26_the_folder_of_leases_is_made_with_those_above_it_for_this_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "new" / "leases"
    monkeypatch.setenv("TCI_LEASES", str(folder))
    with lease(NAME):
        assert folder.stat().st_mode & 0o777 == 0o700
        assert file_in(folder).read_text() == f"process {os.getpid()}"
        assert file_in(folder).stat().st_mode & 0o777 == 0o600


def test_26_a_folder_that_depends_on_where_a_program_starts_is_refused_by_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("TCI_LEASES", "here/leases")
    refused(r"^TCI_LEASES is 'here/leases'; valid: an absolute path, wherever a program is started$")


def write(driver: Driver) -> None:
    driver.write(driver.gate.step((), driver.read().joints, driver.clock.now()))


def test_26_a_loop_of_ones_own_commands_a_real_robot_alone_until_it_closes(folder: Path) -> None:
    driver = DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME)
    write(driver)
    code = f"from tci.drivers.lease import Lease; Lease({NAME!r})"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert f"{NAME} is commanded by process {os.getpid()} already" in other.stderr
    write(driver)
    driver.close()
    with lease(NAME):
        pass


def test_26_a_loop_of_ones_own_writes_nothing_while_another_process_commands(folder: Path) -> None:
    code = f"from tci.drivers.lease import Lease; held = Lease({NAME!r}); print('held', flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME) as driver:
            with pytest.raises(DriverError, match=f"commanded by process {other.pid} already"):
                write(driver)
            other.kill()
            other.wait()
            write(driver)


def test_26_a_run_after_a_loop_of_ones_own_has_the_lease_too(folder: Path) -> None:
    with DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME) as driver:
        write(driver)
        assert tci.run(driver, tci.WithdrawalReflex(), duration=0.01)
        write(driver)


def test_26_a_second_driver_of_this_process_writes_beside_the_first(folder: Path) -> None:
    drivers = [DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME) for _ in range(2)]
    for driver in drivers:
        write(driver)


def test_26_a_simulation_of_ones_own_needs_no_lease(folder: Path) -> None:
    write(SimulatedDriver(tci.load_robot("nao")))
    assert not folder.exists()


def test_26_a_wrapper_uses_the_lease_of_the_driver_inside(folder: Path) -> None:
    driver = DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME)
    write(driver)
    with DriverWrapper(driver) as wrapped:
        assert tci.run(wrapped, tci.WithdrawalReflex(), duration=0.01)
    with lease(NAME):
        pass


def test_26_a_driver_that_is_dropped_without_closing_gives_the_lease_back(folder: Path) -> None:
    driver = DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME)
    write(driver)
    del driver
    gc.collect()
    with lease(NAME):
        pass


def test_26_a_second_driver_of_this_process_checks_the_lease_too(folder: Path) -> None:
    first, second = (DriverWrapper(SimulatedDriver(tci.load_robot("nao")), lease_name=NAME) for _ in range(2))
    write(first)
    write(second)
    file_in(folder).unlink()
    code = f"from tci.drivers.lease import Lease; held = Lease({NAME!r}); print('held', flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=-1, stdout=-1, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        for driver in (second, first):
            with pytest.raises(DriverError, match=f"commanded by process {other.pid} already"):
                write(driver)
        other.kill()


def test_26_a_run_that_only_reads_takes_no_lease(folder: Path) -> None:
    with (
        DriverWrapper(SimulatedDriver(tci.load_robot("nao"), arm=False), lease_name=NAME) as driver,
        lease(NAME),
    ):
        tci.run(driver, tci.WithdrawalReflex(), duration=0.01, write=False)
