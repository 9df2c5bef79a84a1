"""Rows of a Unitree G1 over its own DDS topics: messages exchanged with the vendor's SDKs at 500 Hz, faults
rehearsed, the first motion of a reflex compared with that within one process."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pool import Result, gather
from report import ROOT
from rich.progress import track
from row import Row

from helpers.peers import peer_python
from helpers.rehearsed import EXPECTED, Rehearsed, rehearse
from helpers.wire_peers import Unitree
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.poke import Stimulus
from tci.robot.catalogue import load_robot
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.wire import COMMAND, STATE, WEIGHT, decode_state, encode_command, encode_state

COUNT, RATE = 10_000, 500.0
"""Number of messages in each direction, and their rate [Hz]."""
DOMAIN = 117
"""DDS domain of the SDK in Python. The SDK in C++ supports only domain 0."""
MORE = 1.2
"""Number of commands sent for each command that the SDK must receive. The SDK keeps only the newest
command."""
PATIENCE = 30.0
"""Longest time [s] to wait in addition to the time of all messages."""
PEER = ROOT / "tests" / "helpers" / "sdk_peer.py"
TRIES = 10
"""Number of attempts to rehearse one fault if the machine delays the processes. Assumed: at least one of ten
attempts is in time even if other programs run."""
WIRES = None, "unitree:lo/116 + yarp"
"""Connections between reflex and robot: None for a reflex within the robot's process, otherwise the address
of two middleware: joints over Unitree's topics, skin sleeves over YARP."""
POKES = 10
"""Number of pokes of one job: five fields of two arms."""
ABOVE = 10.0
"""Largest time [ms] by which the middleware may delay the first motion."""


def unitree_messages(full: bool) -> Row:
    """Sends commands to a robot program of the SDK in Python, which checks them, and reads the states of a
    robot program in C++."""
    count = COUNT if full else COUNT // 20
    heard, bad = _commands(count)
    states, wrong = _states(count)
    encode, decode = _costs()
    return Row(
        "messages of a G1 at 500 Hz, exchanged with the vendor's SDKs",
        min(heard, states),
        COUNT,
        "messages in each direction",
        f"{bad} of {heard} commands and {wrong} of {states} states with a wrong checksum; median time to "
        f"encode a message {encode * 1e6:.1f} us, to decode a message {decode * 1e6:.1f} us",
        "0 wrong checksums, at most 20 us for each message",
        bool(heard and states) and not bad and not wrong and max(encode, decode) <= 20e-6,
    )


def _commands(count: int) -> tuple[int, int]:
    """Returns the number of commands that the SDK in Python received, and the number with a wrong
    checksum."""
    with vendor_program("py_robot", DOMAIN) as process:
        node = InterfaceNode("lo", DOMAIN)
        send = node.out("rt/arm_sdk", messages.COMMAND)
        states = node.reader("rt/lowstate", messages.STATE, keep=MOST)
        command: Any = np.zeros((), COMMAND)
        command["mode_machine"] = 5
        end = time.monotonic() + PATIENCE
        while not latest(states) and time.monotonic() < end:  # until the two programs are connected
            time.sleep(0.01)
        due = time.monotonic()
        for left in reversed(range(round(MORE * count))):
            command["motor"]["q"][18] = 1e-4 * left
            command["motor"]["q"][WEIGHT] = float(left > 0)
            send(encode_command(command))
            due += 1.0 / RATE
            time.sleep(max(0.0, due - time.monotonic()))
        found = ended(process)
        node.close()
    return int(found["commands"]), int(found["wrong"])


def _states(count: int) -> tuple[int, int]:
    """Returns the number of states that TCI received from the SDK in C++, and the number with a wrong
    checksum."""
    heard = wrong = 0
    with vendor_program("cpp_robot", 0) as process:
        node = InterfaceNode("lo", 0)
        states = node.reader("rt/lowstate", messages.STATE, keep=MOST)
        end = time.monotonic() + count / RATE + PATIENCE
        while heard < count and time.monotonic() < end:
            for sample in latest(states):
                heard += 1
                wrong += not decode_state(sample.raw)[1]
            time.sleep(0.002)
        ended(process)
        node.close()
    return heard, wrong


def _costs() -> tuple[float, float]:
    """Returns the median time [s] to encode a command as bytes, and the median time [s] to decode a state."""
    command: Any = np.zeros((), COMMAND)
    state = encode_state(np.zeros((), STATE))
    return _median(lambda: encode_command(command)), _median(lambda: decode_state(state))


def _median(work: Callable[[], object]) -> float:
    took = []
    for _ in range(5000):
        begin = time.perf_counter()
        work()
        took.append(time.perf_counter() - begin)
    return float(np.median(took))


def vendor_program(role: str, domain: int, *more: str) -> subprocess.Popen[str]:
    """Starts a program of the vendor's SDKs. Returns the process when it is ready."""
    command = [peer_python("unitree"), str(PEER), role, str(domain), *more]
    process = subprocess.Popen(command, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    while "ready" not in (line := process.stdout.readline()):
        assert line, f"{role} does not start"
    return process


def ended(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Ends a robot program and returns the results that it prints."""
    said, _ = process.communicate(timeout=PATIENCE)
    found: dict[str, Any] = json.JSONDecoder().raw_decode(said, said.index('{"'))[0]
    return found


def unitree_faults(full: bool) -> Row:
    """Rehearses each fault on a served robot whose arms move. Repeats a rehearsal that ends otherwise than
    expected if the loop or the robot got no processor time meanwhile."""
    names = [*EXPECTED] if full else ["dropped-frames", "stall"]
    found: dict[str, Rehearsed] = {}
    again = 0
    peer = Unitree()
    peer.start()
    try:
        for name in track(names, "faults over Unitree's topics"):
            for _ in range(TRIES):
                found[name] = rehearse(peer, name)
                if not (found[name].wrong and found[name].late):
                    break
                again += 1
    finally:
        peer.stop()
    wrong = [f"{name}: {one.wrong}" for name, one in found.items() if one.wrong]
    return Row(
        "faults injected into a G1, over Unitree's topics", len(found), len(EXPECTED), "faults",
        f"{len(found) - len(wrong)} with the expected result; {again} delayed trials repeated "
        f"{'; '.join(wrong)}".strip(),
        "all with the expected result", not wrong,
    )  # fmt: skip


def unitree_motion(full: bool) -> Row:
    """Pokes each field of both arms. The robot, the keeper of its motors and the reflex run in separate
    processes."""
    jobs = [(via, POKES * number) for via in WIRES for number in range(3 if full else 1)]
    done = gather("unitree_motion", _pokes, jobs, full=full, alone=True)
    near, far = (
        np.array([time for one in done if one["wire"] is wire for time in one["first"]], dtype=float)
        for wire in (False, True)
    )
    pokes = min(len(near), len(far))
    late = far[:pokes] - near[:pokes]  # NaN if the robot never moved
    above = float(np.median(late)) if pokes else np.nan
    least, most = (bound(late, initial=0.0) for bound in (np.min, np.max))
    return Row(
        "delay of a G1's first motion, caused by the connection over Unitree's topics",
        pokes,
        3 * POKES,
        "pokes",
        f"median {above:.0f} ms, smallest {least:.0f} ms, largest {most:.0f} ms",
        f"median at most {ABOVE:g} ms",
        bool(above <= ABOVE),
    )


def _pokes(via: str | None, seed: int) -> Result:
    trials = [*trials_of(load_robot("g1"), WithdrawalReflex(), stimulus=Stimulus(), seed=seed, via=via)]
    return {"wire": via is not None, "first": [trial.first_motion_ms for trial in trials]}
