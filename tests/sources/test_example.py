"""The source of the page about hands runs as it stands, and finds its way past a mark among the values."""

from __future__ import annotations

import re
import socket
import time
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np

from helpers import ROOT
from helpers.touch_devices import TouchDevice
from tci.drivers.source_reader import SourceReader

(TEXT,) = re.findall(
    r"```python\n((?:(?!```).)*class Pad\(Source\).*?)```",
    (ROOT / "docs" / "sources.md").read_text(),
    re.DOTALL,
)


class Pad(TouchDevice):
    """The pad that the page describes: a mark and 12 x 32 bytes, over TCP."""

    pads: ClassVar = {"pad": 384}
    most = 255

    @property
    def via(self) -> str:
        return f"127.0.0.1:{self.port}"

    def serve(self) -> None:
        with socket.create_server(("127.0.0.1", self.port)) as door:
            door.settimeout(0.05)
            while self._in.is_set():
                with suppress(OSError):
                    link, _ = door.accept()
                    with link:
                        link.sendall(b"\x17\xaa\x55" + bytes(self.values["pad"][:40]))  # in mid-frame
                        while self._in.is_set():
                            link.sendall(b"\xaa\x55" + bytes(self.values["pad"]))
                            time.sleep(0.01)


def test_the_example_has_forty_lines_and_reads_a_pad_that_goes_and_comes_back() -> None:
    assert len([line for line in TEXT.splitlines() if line.strip()]) <= 40
    names: dict[str, Any] = {}
    exec(compile(TEXT, "docs/sources.md", "exec"), names)
    pad = Pad()
    pad.number()
    pad.values["pad"][10:12] = 0xAA, 0x55
    pad.plug()
    time.sleep(0.1)
    source = names["Pad"](pad.via)
    reader = SourceReader("my-pad", source, source.pads)
    try:
        seen = reader.pads["pad"]
        reader.wait(5.0)
        for _ in range(50):
            assert np.array_equal(seen.values, pad.values["pad"])
            time.sleep(0.002)
        pad.unplug()
        end = time.monotonic() + 10.0
        while not reader.trouble and time.monotonic() < end:
            time.sleep(0.01)
        assert reader.trouble
        pad.values["pad"][0] = 99
        pad.plug()
        while seen.values is None or seen.values[0] != 99:
            assert time.monotonic() < end, "it does not come back"
            time.sleep(0.01)
    finally:
        reader.close()
        pad.unplug()
