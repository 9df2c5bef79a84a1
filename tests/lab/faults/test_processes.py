"""Faults between processes, tested with real processes. The names of the tests contain the number of the
fault in the catalogue."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

import tci
from tci.drivers.lease import lease
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.gate.gate import GateState
from tci.recording.recording import Recording
from tci.runtime.heartbeat import Listener
from tci.runtime.loop import Tick, run
from tci.simulation.world import World

HOLDER = """
import sys, time
from tci.drivers.lease import lease
with lease("the robot of this test"):
    print("has it", flush=True)
    time.sleep(60.0)
"""
PEER = """
import sys, time
from tci.runtime.heartbeat import INTERVAL, Sender
sender = Sender("brain", int(sys.argv[1]))
while True:
    sender.beat()
    time.sleep(INTERVAL)
"""


@pytest.mark.parametrize("variable", ["XDG_RUNTIME_DIR", "TMPDIR"])
def test_26_another_process_that_commands_is_named_and_when_it_is_killed_the_robot_is_free(
    variable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lease must also work if only one of the two processes has the folders of a user session, as with
    cron or sudo."""
    monkeypatch.delenv(variable, raising=False)
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER], stdout=subprocess.PIPE, text=True,
        env={**os.environ, variable: str(tmp_path)},
    ) as holder:  # fmt: skip
        assert holder.stdout is not None
        assert holder.stdout.readline() == "has it\n"
        with (
            pytest.raises(DriverError, match=f"commanded by process {holder.pid} already"),
            lease("the robot of this test"),
        ):
            pass
        holder.kill()
        holder.wait()
    with lease("the robot of this test"):
        pass


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_28_a_process_that_is_needed_dies_and_the_robot_holds(how: signal.Signals) -> None:
    world = World(tci.load_robot("nao"), skin=False)
    driver = SimulatedDriver(world.robot, world=world, paced=True)
    states: list[tuple[float, GateState, str]] = []
    with Listener(["brain"]) as listener:
        peer = subprocess.Popen([sys.executable, "-c", PEER, str(listener.port)])
        try:
            while listener.fault():
                time.sleep(0.01)
            killed: list[float] = []

            def observe(tick: Tick) -> None:
                states.append((time.monotonic(), tick.sent.state, tick.sent.reason))
                if len(states) == 50:
                    peer.send_signal(how)
                    killed.append(time.monotonic())

            run(driver, tci.WithdrawalReflex(), duration=1.0, guard=listener.fault, observe=observe)
        finally:
            peer.kill()
            peer.wait()
    later = [(when, reason) for when, state, reason in states if state is GateState.HOLD and when > killed[0]]
    assert states[-1][1] is GateState.HOLD
    assert "no heartbeat of brain" in str(later[-1][1])
    assert all(state is not GateState.STOP for _, state, _ in states)


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_42_a_signal_ends_tci_run_with_the_robot_at_rest_and_the_recording_whole(
    how: signal.Signals, status: int, tmp_path: Path
) -> None:
    file = tmp_path / "a.mcap"
    command = [sys.executable, "-m", "tci.cli.main", "run", "withdrawal", "nao", "--poke"]
    command += ["--record", str(file)]
    process = subprocess.Popen([*command, "--json"], stdout=subprocess.PIPE, text=True)
    while not file.exists() or file.stat().st_size < 100_000:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(how)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == status, said
    assert "the robot was brought to rest" in said
    assert json.loads(said)["state"] == "stop"
    recording = Recording(file)
    assert len(list(recording.ticks())) > 10
    assert recording.complete


@pytest.mark.parametrize("via", ["player:127.0.0.1:", "zenoh:tcp/127.0.0.1:"])
def test_36_serving_at_a_port_that_is_taken_is_one_error_and_an_exit_status(via: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "tci.cli.main", "serve", "nao", "--via", f"{via}{port}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode not in (0, None)
    assert "in use" in done.stderr + done.stdout
    assert str(port) in done.stderr + done.stdout
    assert "Traceback" not in done.stderr
