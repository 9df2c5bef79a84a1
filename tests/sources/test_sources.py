"""Contract that every source must fulfil. A new source adds a stand-in of its device, made from what the
maker publishes, to `DEVICES`."""

from __future__ import annotations

import importlib.util
import json
import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers.serial_devices import SERIAL_DEVICES
from helpers.touch_devices import (
    InspireBridge,
    InspireHand,
    Linkerhand,
    Program,
    Ros1Topic,
    Ros2Topic,
    TcpLines,
    TouchDevice,
    UdpLines,
    Xela,
)
from tci.cli.main import app
from tci.drivers.diagnosis import Level
from tci.drivers.registry import SOURCES, load_source, source_at
from tci.drivers.source_reader import SourceReader
from tci.drivers.sourced import Address
from tci.errors import DriverError

pytestmark = pytest.mark.timeout(60)
DEVICES: list[type[TouchDevice]] = [
    InspireHand,
    TcpLines,
    UdpLines,
    Program,
    Ros1Topic,
    Ros2Topic,
    InspireBridge,
    Linkerhand,
    Xela,
    *SERIAL_DEVICES,
]


def reader_of(device: TouchDevice) -> SourceReader:
    source = source_at(device.via)
    assert source.pads in ({}, device.pads)
    device.meet(source)
    return SourceReader(device.via, source, device.pads)


def wait_for(what: Callable[[], bool], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)


def equal(reader: SourceReader, device: TouchDevice) -> bool:
    return all(
        reader.pads[pad].values is not None and np.array_equal(reader.pads[pad].values, values)
        for pad, values in device.values.items()
    )


def silent(reader: SourceReader) -> list[str]:
    return [pad for pad in reader.pads if reader.silence(pad, time.monotonic()) is not None]


@pytest.fixture(params=[
    pytest.param(one, id=one.__name__, marks=[pytest.mark.xdist_group("driver-ros1")] * (one is Ros1Topic))
    for one in DEVICES
])  # fmt: skip
def device(request: pytest.FixtureRequest) -> Iterator[TouchDevice]:
    made: TouchDevice = request.param()
    if made.needs and importlib.util.find_spec(made.needs) is None:
        pytest.skip(f"did not run: needs {made.needs}; to get it: make test, which installs all extras")
    made.plug()
    yield made
    made.unplug()


@pytest.fixture
def reader(device: TouchDevice) -> Iterator[SourceReader]:
    time.sleep(0.1)  # the device opens its door
    found = reader_of(device)
    yield found
    found.close()


def test_frames_are_complete_fresh_and_numbered_and_loss_lateness_and_rubbish_pass(
    device: TouchDevice, reader: SourceReader
) -> None:
    device.number()
    wait_for(lambda: equal(reader, device))
    before = {pad: state.sequence for pad, state in reader.pads.items()}
    time.sleep(0.3)
    now = time.monotonic()
    for pad, state in reader.pads.items():
        assert state.sequence > before[pad] + 3, "no frames"
        assert 0.0 <= now - state.stamp < 0.3
        assert state.rate > 10.0
        assert 0.0 < state.jitter < 0.1
    assert not silent(reader)
    told = [one for one in reader.diagnose() if one.level is not Level.OK]
    assert not [one for one in told if one.level is not Level.NOTE]

    wrong: list[str] = []  # what one pad gets must never be another pad's: values tell whose they are
    for fault in ("late", "lost", "short"):
        if fault == "late":
            device.delay = 0.4
        elif fault == "lost":
            device.lose = 3
        else:
            device.short = True
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            for pad, state in reader.pads.items():
                if not np.array_equal(state.values, device.values[pad]):
                    wrong.append(f"{fault}: {pad}")
            time.sleep(0.01)
        device.short = False
        wait_for(lambda: not silent(reader))
    assert not wrong
    assert any(one.level is Level.WARNING for one in reader.diagnose()), "the wrong length was not told"


def test_stuck_and_unplugged_are_told_and_the_device_comes_back(
    device: TouchDevice, reader: SourceReader
) -> None:
    wait_for(lambda: all(state.sequence > 5 for state in reader.pads.values()))
    assert any("no value of" in one.what for one in reader.diagnose()), "stuck values are no sign of life"
    device.unplug()
    wait_for(lambda: len(silent(reader)) == len(reader.pads))
    device.number()
    device.plug()
    wait_for(lambda: equal(reader, device) and not silent(reader))
    assert not any("no value of" in one.what for one in reader.diagnose())
    assert not any(one.level is Level.FAULT for one in reader.diagnose())


def test_a_second_client_gets_all_or_is_told_and_nothing_but_reads_is_sent(
    device: TouchDevice, reader: SourceReader
) -> None:
    device.number()
    wait_for(lambda: equal(reader, device))
    if not device.second:
        with pytest.raises(DriverError, match=device.via):
            reader_of(device)
    else:
        second = reader_of(device)
        wait_for(lambda: equal(second, device) or bool(second.trouble))
        if device.alone:
            reader.close()
            wait_for(lambda: equal(second, device))
        second.close()
    assert [request.hex() for request in device.received if not device.may_be_sent(request)] == []


def test_a_serial_port_is_read_and_its_end_is_told() -> None:
    device, port = pty.openpty()
    via = Address.of(f"array:serial://{os.ttyname(port)},baud=115200")
    reader = SourceReader("serial", via.make(load_source("array")), {"palm": 5})
    try:
        for k in range(3):
            os.write(device, f"palm: 1; 2, nan -1 {k}\n# a remark\nelsewhere 1 2\npa".encode())
            os.write(device, b"lm 1,2\n")
            wait_for(lambda: reader.pads["palm"].sequence == k + 1)  # noqa: B023
        assert np.array_equal(reader.pads["palm"].values, [1, 2, np.nan, np.nan, 2], equal_nan=True)
        assert len(reader.rejected) == 2
        os.close(port)
        os.close(device)
        wait_for(lambda: bool(reader.trouble))
    finally:
        reader.close()


def test_the_doctor_examines_the_source_and_the_robot() -> None:
    device = UdpLines()
    device.values = {"left_hand": [0] * 3}
    device.plug()
    command = ["doctor", "nao", "--via", f"sim + {device.via},patch=left_hand", "--duration", "0.5", "--json"]
    found = CliRunner().invoke(app, command)
    device.unplug()
    subjects = {one["subject"]: one for one in json.loads(found.stdout)["findings"]}
    assert f"{device.via},patch=left_hand" in subjects
    assert {"left_hand", "left_forearm", "joints"} <= subjects.keys()


def test_what_a_source_sends_wrong_is_told_and_no_frame_is_made_of_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    device = UdpLines()
    device.values = {"left_hand": [0] * 2}
    device.plug()
    command = ["doctor", "nao", "--via", f"sim + {device.via},patch=left_hand", "--duration", "0.5", "--json"]
    found = CliRunner().invoke(app, command)
    device.unplug()
    findings = [one for one in json.loads(found.stdout)["findings"] if one["level"] in ("fault", "warning")]
    told = {(one["subject"], one["what"].split(" ", 1)[-1]) for one in findings}
    via = f"{device.via},patch=left_hand"
    wrong = "left_hand: 2 values of type float32; valid: 3 numbers"
    assert told == {
        (via, "is open, and nothing usable has come"),
        (via, f"messages unusable: {wrong}"),
        ("left_hand", "frame at all"),
    }
    assert [one.message for one in caplog.records] == [f"{via}: unusable: {wrong}"]


def test_who_is_not_there_is_named() -> None:
    for via in ("inspire:127.0.0.1:9", "array:tcp://127.0.0.1:9", "array:serial:///dev/nothing"):
        address = Address.of(via)
        with pytest.raises(DriverError, match=f"^{via}"):
            SourceReader(via, address.make(load_source(address.name)), {"palm": 5})


def test_every_source_is_held_to_this_contract() -> None:
    assert {one.name for one in entry_points(group=SOURCES)} == {
        Address.of(device().via).name for device in DEVICES
    }


def test_sources_load_no_simulation() -> None:
    names = [point.module for point in entry_points(group=SOURCES)]
    code = f"""
import importlib, sys
for name in {names}:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        assert error.name in ("can", "websockets"), error
print(*sys.modules)"""
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"mujoco", "numba", "scipy", "pydantic"} & {*found}
