"""`xela:HOST[:PORT]`: the sensors of XELA's uSkin, as the maker's server (`xela_server`) sends them.

The server speaks WebSocket. A message has one entry for each sensor, by its number: the time, the model, the
number of taxels, their raw values in hexadecimal, three for each taxel, and calibrated ones if it was told to
(XELA, xela_server_ros2 3a890cf6). At rest a raw value is about 32768. Given 127.0.0.1, a server that listens
at the computer's outgoing address is not found: write that one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect

from tci.drivers.source import Sample, Source
from tci.errors import DriverError, FrameError
from tci.shared.axes import along, values_per_point

PORT = 5000
WAIT = 0.2
"""Longest time [s] of one `read`."""
FIRST = 2.0
"""Longest time [s] until the first message with sensors."""


class XelaSource(Source):
    """One pad for each sensor: `sensor_1` and so on."""

    def __init__(self, address: str = "", *, axes: str = "z", values: str = "raw") -> None:
        """
        Args:
            address: Host of the server, and its port if that is not 5000.
            axes: z for the force across each taxel, xyz for all three.
            values: raw, or calibrated for newtons, which the server must be told to send.

        Raises DriverError for an address or option that can't be meant.
        """
        super().__init__(address)
        host, _, port = address.rpartition(":") if ":" in address else (address, "", str(PORT))
        if not host or not port.isdecimal() or values not in ("raw", "calibrated"):
            raise DriverError(
                f"xela:{address},values={values}; valid: xela:HOST or :PORT, values=raw or calibrated"
            )
        self._url, self._axes, self._calibrated = f"ws://{host}:{port}", axes, values == "calibrated"
        self.device = "xela-uskin-newtons" if self._calibrated else "xela-uskin"
        self.values_per_point = values_per_point(axes)
        self._link: ClientConnection | None = None

    def find_pads(self) -> None:
        try:
            self.open()
            end = time.monotonic() + FIRST
            while not self.pads and time.monotonic() < end:
                found = self._receive()
                self.pads = {
                    f"sensor_{key}": self.values_per_point * int(one["taxels"]) for key, one in found.items()
                }
        except (KeyError, TypeError, ValueError) as error:
            raise DriverError(f"{self._url} is no server of XELA: {error!r}") from error
        finally:
            self.close()
        if not self.pads:
            raise DriverError(f"{self._url} tells no sensor; check the sensors' cables, and xServ.ini")

    def open(self) -> None:
        try:
            self._link = connect(self._url, open_timeout=2.0, compression=None)
        except InvalidHandshake as error:
            raise DriverError(f"{self._url} is no WebSocket: {error}") from error

    def read(self) -> Iterator[Sample]:
        fault = ""
        for key, one in self._receive().items():
            try:
                points, stamp = self._points(one), float(one["time"])
            except (KeyError, TypeError, ValueError) as error:
                fault = f"sensor {key}: {error}"[:120]
            else:
                yield Sample(f"sensor_{key}", along(points, self._axes), stamp)
        if fault:
            raise FrameError(fault)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    def _points(self, one: dict[str, Any]) -> NDArray[np.generic]:
        """(n, 3). Raises KeyError, TypeError or ValueError for a sensor whose values are not that."""
        values: NDArray[np.generic]
        if not self._calibrated:
            values = np.array([int(word, 16) for word in one["data"].split(",")], np.uint16)
        elif one.get("calibrated"):
            values = np.array(one["calibrated"], np.float32)
        else:
            raise ValueError("the server sends no calibrated values; valid: values=raw")
        if values.size != 3 * int(one["taxels"]):
            raise ValueError(f"{values.size} values, expected 3 for each of {one['taxels']} taxels")
        return values.reshape(-1, 3)

    def _receive(self) -> dict[str, dict[str, Any]]:
        """The sensors of the next message, by number; nothing if none comes in time, or it greets only."""
        if self._link is None:
            raise ConnectionResetError("not open")
        try:
            message = json.loads(self._link.recv(timeout=WAIT))
        except TimeoutError:
            return {}
        except ConnectionClosed as error:
            raise ConnectionResetError(f"{self._url} closed the connection") from error
        except ValueError as error:
            raise FrameError(f"no JSON: {error}"[:120]) from error
        entries = message.items() if isinstance(message, dict) else ()
        return {key: one for key, one in entries if key.isdecimal() and isinstance(one, dict)}
