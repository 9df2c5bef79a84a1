"""The viewer shows a robot of another process, and moves the robot only if it is armed."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import tci
from tci.lab.viewer.labels import badge
from tci.lab.viewer.session import Session

PATIENCE = 60.0


def wait_for(what: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


@contextmanager
def serving() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serves a NAO within the context. Yields the address and the process."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        port = found.getsockname()[1]
    via = f"zenoh:tcp/127.0.0.1:{port}"
    command = [sys.executable, "-m", "tci.cli.main", "serve", "nao", "--via", via]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert "serving nao" in server.stdout.readline()
        yield via, server
        server.terminate()


@pytest.fixture(scope="module")
def via() -> Iterator[str]:
    with serving() as (via, _):
        yield via


def test_a_robot_of_another_process_is_shown(via: str) -> None:
    session = Session(tci.connect(tci.load_robot("nao"), via), tci.WithdrawalReflex(), about={})
    session.start()
    wait_for(lambda: session.view is not None and session.view.pressure)
    assert session.view is not None
    assert session.view.state is None
    first = session.view.time
    wait_for(lambda: session.view is not None and session.view.time > first)
    session.close()


def test_one_that_died_is_not_shown_as_if_it_lived() -> None:
    with serving() as (via, server):
        session = Session(tci.connect(tci.load_robot("nao"), via), tci.WithdrawalReflex(), about={})
        session.start()
        wait_for(lambda: session.view is not None and session.view.pressure)
        server.kill()
        wait_for(lambda: session.view is not None and "joint data is" in session.view.reason)
        assert "ms old" in badge("NAO", session.view, session.ended)
        session.close()


def test_an_armed_one_follows_the_sliders(via: str) -> None:
    driver = tci.connect(tci.load_robot("nao"), via, arm=True)
    session = Session(driver, tci.WithdrawalReflex(), about={})
    session.start()
    wait_for(lambda: session.view is not None and session.view.state is not None)
    assert session.view is not None
    target = np.array(session.view.posture["left_arm"])
    target[1] += 0.3

    def there() -> bool:
        # If the machine is too busy for real time, the gate holds and refuses orders meanwhile.
        session.move("left_arm", target)
        return session.view is not None and abs(session.view.posture["left_arm"][1] - target[1]) < 0.02

    wait_for(there)
    session.close()
