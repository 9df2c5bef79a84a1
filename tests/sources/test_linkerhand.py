"""A LinkerHand on a virtual bus, where another author's client and ours read the same stand-in."""

from __future__ import annotations

import json
import os
import subprocess

import pytest

import tci
from helpers import ROOT, TESTS
from helpers.peers import peer_python
from tci.errors import DriverError

pytestmark = pytest.mark.timeout(60)
BOTH = """
import json, os, sys, time
from helpers.touch_devices import Linkerhand, LinkerhandO6
from linkerbot import L6, O6
from tci.drivers.source_reader import SourceReader
from tci.sources.linkerhand.source import LinkerhandSource
found = []
for make, client, matrix, kind in ((Linkerhand, L6, "12x6", "L6"), (LinkerhandO6, O6, "10x4", "")):
    hand = make()
    hand.number()
    hand.plug()
    time.sleep(0.1)
    theirs = client("right", f"bus-{hand.port}", interface_type="virtual")
    theirs.stop_polling()
    data = theirs.force_sensor.get_blocking(timeout_ms=5000)
    names = {"pinky": "little"}
    theirs_read = {
        f"{names.get(one, one)}_tip": getattr(data, one).values.ravel().tolist()
        for one in ("thumb", "index", "middle", "ring", "pinky")
    }
    if kind:
        theirs_read["angles"] = theirs.angle.get_blocking(timeout_ms=5000).angles.to_raw()
    theirs.close()
    source = LinkerhandSource(
        f"bus-{hand.port}", side="right", interface="virtual", matrix=matrix, hand=kind
    )
    ours = SourceReader("hand", source, source.pads)
    ours.wait(5.0)
    ours_read = {pad: state.values.tolist() for pad, state in ours.pads.items()}
    if kind:
        ours_read["angles"] = [round(255 * angle) for angle in ours.track.latest.values()]
    found.append([theirs_read, ours_read])
    ours.close()
    hand.unplug()
print(json.dumps(found), flush=True)
os._exit(0)
"""


def test_another_authors_client_reads_the_same_values() -> None:
    paths = os.pathsep.join((str(ROOT / "src"), str(TESTS)))
    done = subprocess.run(
        [peer_python("hands"), "-c", BOTH],
        env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not done.returncode, done.stderr
    for (theirs, ours), size in zip(json.loads(done.stdout), (72, 40), strict=True):
        assert ours == theirs
        assert ours.pop("angles", [250, 200, 150, 100, 50, 0]) == [250, 200, 150, 100, 50, 0]
        assert [len(values) for values in ours.values()] == 5 * [size]


def test_a_bus_without_the_hand_is_told_from_one_that_is_down(monkeypatch: pytest.MonkeyPatch) -> None:
    can = pytest.importorskip("can", reason="did not run: needs python-can; to get it: make test")
    from tci.sources.linkerhand.source import LinkerhandSource

    with can.Bus("alone", interface="virtual") as other:
        source = LinkerhandSource("alone", side="left", interface="virtual")
        source.wants = ("thumb_tip",)
        source.open()
        with pytest.raises(
            DriverError, match=r"no answer from the hand with the id 0x28: power it, then replug"
        ):
            list(source.read())
        for message in iter(lambda: other.recv(0.0), None):  # an adapter that sends back what it sends
            other.send(message)
        with pytest.raises(DriverError, match=r"only our own requests come back.*replug the adapter"):
            list(source.read())
        source.close()
    monkeypatch.setattr("tci.sources.linkerhand.source.can_channels", lambda: {"can0": "down"})
    with pytest.raises(DriverError, match=r"can0 is down; bring it up: sudo ip link set can0 up type can"):
        LinkerhandSource("can0", side="left").open()


def test_which_hand_must_be_said() -> None:
    pytest.importorskip("can", reason="did not run: needs python-can; to get it: make test")
    with pytest.raises(DriverError, match=r"side=left or side=right, matrix=12x6 or 10x4"):
        tci.connect("g1-inspire", "sim + linkerhand:can0")
