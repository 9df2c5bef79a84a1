"""The socket at which a served robot is asked to be touched."""

from __future__ import annotations

import json
import socket
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from types import SimpleNamespace

import pytest

import tci
from tci.cli.touch_desk import TouchDesk


def test_what_was_felt_is_counted_while_the_loop_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a slow machine the loop noted a further period between two looks at its notes: the answer was "fp
    and xp are not of the same length"."""
    words = [f"press 'left forearm' 3N 0.1s @{0.5 + k}s" for k in range(8)]
    ended, often = Event(), sys.getswitchinterval()
    with (
        TemporaryDirectory() as folder,
        tci.connect("nao", "sim", people=1) as driver,
        socket.socket(socket.AF_UNIX) as client,
    ):
        monkeypatch.setenv("TCI_LEASES", folder)

        def loop() -> None:
            while not ended.is_set():
                driver.world.advance(driver.world.time + 0.05)
                for _ in range(60):
                    desk.see(SimpleNamespace(now=driver.world.time, perception=SimpleNamespace(contacts=())))

        with TouchDesk(driver, "zenoh", "sim") as desk:
            (path,) = Path(folder).glob("touch-nao-zenoh-*.sock")
            client.connect(str(path))
            thread = Thread(target=loop)
            sys.setswitchinterval(1e-6)
            thread.start()
            try:
                client.sendall(json.dumps({"touch": words, "touches": None}).encode() + b"\n")
                with client.makefile("rb") as lines:
                    answers = [json.loads(line) for line in lines]
            finally:
                ended.set()
                thread.join()
                sys.setswitchinterval(often)
    begun, done = answers
    assert [row["kind"] for row in begun["begun"]] == ["press"] * 8
    assert [row["felt_N"] for row in done["done"]] == [0.0] * 8
    assert done["missed_touches"] == []
