"""Coverage-guided fuzzing of readers of untrusted bytes: `python tools/reliability/fuzz.py TARGET SECONDS`.
Without a target it lists all targets.

The library atheris (libFuzzer) records the lines of `tci` that an input executes, and searches for inputs
that execute other lines. Any exception other than a TciError ends the program and writes the input to a file
`crash-...`.
"""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

TESTS = Path(__file__).parents[2] / "tests"
MEMORY = 2048
"""Memory limit of a target [MB]."""
LONGEST = 16384
"""Largest input [bytes]."""
Target = Callable[[bytes], object]


def by_file(read: Callable[[Path], object], name: str) -> Target:
    """Returns a fuzz target that reads a file."""
    path = Path(tempfile.mkdtemp()) / name

    def target(data: bytes) -> None:
        path.write_bytes(data)
        read(path)

    return target


def description() -> tuple[Target, Iterable[bytes]]:
    """Robot descriptions in XML."""
    from helpers.xml_sample import GOOD
    from tci.robot.xml import read_robot

    return by_file(read_robot, "robot.xml"), [GOOD.encode()]


def facts() -> tuple[Target, Iterable[bytes]]:
    """Facts about a served robot, in JSON."""
    import json

    import tci
    from tci.exports.facts import query, read_facts

    known = query(tci.load_robot("nao")).model_dump(mode="json")
    return read_facts, [json.dumps(known | {"patches": []}).encode()]


def skin_file() -> tuple[Target, Iterable[bytes]]:
    """Skin calibration files of iCub and NAO."""
    from tci.robot.skin_files.file import read_skin_file

    seed = b"[calibration]\ntaxelsCalibration (\n0.1 0.2 0.3 0 0 1 2\n)\n[SENSORS]\nnumber_triangles 1\n"
    return by_file(read_skin_file, "skin.txt"), [seed]


def recording() -> tuple[Target, Iterable[bytes]]:
    """MCAP files."""
    from helpers.recorded import made_up
    from tci.recording.recorder import Recorder
    from tci.recording.recording import Recording

    path = Path(tempfile.mkdtemp()) / "seed.mcap"
    with Recorder(path, None) as recorder:
        for now, reading in made_up(2):
            recorder.tick(now, reading)
    return by_file(lambda file: list(Recording(file).ticks()), "a.mcap"), [path.read_bytes()]


def heartbeat() -> tuple[Target, Iterable[bytes]]:
    """Datagrams of heartbeats."""
    from tci.runtime.heartbeat import decode, encode

    return decode, [encode("brain", 7)]


def remote() -> tuple[Target, Iterable[bytes]]:
    """Messages of a served robot, with a valid checksum, since messages with a wrong checksum are dropped
    before they are parsed."""
    import tci
    from tci.drivers.remote import encoding as remote_cdr
    from tci.errors import TciError

    robot = tci.load_robot("nao")
    readers = {b"S": remote_cdr.to_state, b"F": remote_cdr.to_skin, b"O": remote_cdr.to_orders}

    def target(data: bytes) -> None:
        for kind, read in readers.items():
            with contextlib.suppress(TciError):
                read(robot, remote_cdr.seal(robot, kind, data))
                read(robot, data)

    return target, [b"\x00\x01\x00\x00" + bytes(64)]


def lcm() -> tuple[Target, Iterable[bytes]]:
    """Datagrams of LCM, and their messages."""
    import struct
    import zlib

    import tci
    from tci.errors import TciError
    from tci.wires.lcm import encoding as remote_lcm
    from tci.wires.lcm.datagrams import Datagrams

    robot, datagrams = tci.load_robot("nao"), Datagrams()
    readers = (remote_lcm.to_state, remote_lcm.to_skin, remote_lcm.to_orders)

    def target(data: bytes) -> None:
        datagrams.take(data, "one")
        for read in readers:
            with contextlib.suppress(TciError):
                read(robot, data + struct.pack(">I", zlib.crc32(data)))

    short, piece = b"LC02\0\0\0\1tci/nao/state\0" + bytes(64), b"LC03" + bytes(16) + b"c\0" + bytes(32)
    return target, [short, piece]


def yarp() -> tuple[Target, Iterable[bytes]]:
    """Bottles, vectors and messages in both of YARP's dialects."""
    from yarpwire.bottle import decode_bottle, decode_vector, encode_bottle
    from yarpwire.dialect import V3, V4
    from yarpwire.errors import YarpError
    from yarpwire.message import read_message
    from yarpwire.source import Memory

    def target(data: bytes) -> None:
        for dialect in (V3, V4):
            for read in (decode_bottle, decode_vector):
                with contextlib.suppress(YarpError):
                    read(data, dialect)
        read_message(Memory(data))

    return target, [encode_bottle([1, 2.5, "set", ["pos", [3]]], dialect) for dialect in (V3, V4)]


TARGETS = {
    one.__name__: one for one in (description, facts, skin_file, recording, heartbeat, remote, lcm, yarp)
}


def fuzz(name: str, seconds: float) -> tuple[int, str]:
    """Fuzzes one target in a separate process. Returns the number of inputs and the uncaught errors."""
    command = [sys.executable, str(Path(__file__)), name, f"{seconds:.0f}"]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        lines = done.stderr.splitlines()
        runs = [line.split()[1] for line in lines if line.startswith("Done ")]
        if done.returncode == 0 and runs:
            return int(runs[-1]), ""
        crashes = [path.read_bytes() for path in Path(folder).glob("crash-*")]
        return 0, f"{name}: {crashes[:1] or ''} {' '.join(lines[-6:]) or done.stdout}"


def main() -> None:
    """Runs libFuzzer on one target for some seconds."""
    if len(sys.argv) == 1:
        print("\n".join(TARGETS))
        return
    import atheris

    name, seconds = sys.argv[1:]
    sys.path.insert(0, str(TESTS))
    # Numba can't compile instrumented code.
    import tci.skin.kernels as kernels

    for module in pkgutil.iter_modules(kernels.__path__, f"{kernels.__name__}."):
        importlib.import_module(module.name)

    with atheris.instrument_imports(include=["tci", "yarpwire"]):
        target, seeds = TARGETS[name]()
    from tci.errors import TciError
    from yarpwire.errors import YarpError

    def one_input(data: bytes) -> None:
        with contextlib.suppress(TciError, YarpError):
            target(data)

    corpus = Path(tempfile.mkdtemp())
    for number, seed in enumerate(seeds):
        (corpus / str(number)).write_bytes(seed)
    flags = [f"-max_total_time={seconds}", f"-rss_limit_mb={MEMORY}", f"-max_len={LONGEST}"]
    atheris.Setup([sys.argv[0], *flags, str(corpus)], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
