"""The robot's service `motion_switcher`, which switches its own controller on and off: client and server."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from typing import Any

from tci.drivers.unitree import messages
from tci.drivers.unitree.node import MOST, UnitreeNode, latest
from tci.errors import DriverError

CHECK, SELECT, RELEASE = 1001, 1002, 1003
"""Numbers of the calls."""
UNKNOWN, BAD = 3203, 3204
"""Codes of answers to calls that the server does not have, and that it can't read."""
PATIENCE = 3.0
"""Time [s] that one answer is waited for. Assumed: services answer within milliseconds once connected."""
TRIES = 5
"""Number of release calls after which another program is assumed to keep the controller on. Assumed: usually
one call is enough."""
NAME = "ai"
"""Name of the controller that walks and balances."""


class Switcher:
    """Client of the service."""

    def __init__(self, node: UnitreeNode) -> None:
        self._responses = node.reader(
            "rt/api/motion_switcher/response", messages.RESPONSE, keep=MOST, reliable=True
        )
        self._requests = node.writer("rt/api/motion_switcher/request", messages.REQUEST)

    def check(self) -> str:
        """Returns the name of the controller that runs; empty without one. Raises DriverError."""
        data = self._call(CHECK, {})
        try:
            return str(json.loads(data)["name"])
        except (ValueError, KeyError, TypeError) as error:
            raise DriverError(f"motion_switcher: {data[:80]!r} as an answer; valid: a name") from error

    def release(self) -> None:
        """Switches the robot's own controller off, so that the legs no longer carry the robot. Raises
        DriverError."""
        for _ in range(TRIES):
            if not (name := self.check()):
                return
            self._call(RELEASE, {})
        raise DriverError(f"motion_switcher: the robot's controller {name} stays on after {TRIES} releases")

    def _call(self, api: int, parameter: dict[str, str]) -> str:
        """Returns the data of an answer; repeats the call until the service is connected."""
        end, repeat = time.monotonic() + PATIENCE, 0.0
        numbers = set()
        while (now := time.monotonic()) < end:
            if now >= repeat:
                repeat = now + 0.5
                numbers.add(number := time.monotonic_ns())
                header = messages.REQUEST_HEADER(
                    identity=messages.IDENTITY(id=number, api_id=api), lease=messages.LEASE(id=0),
                    policy=messages.POLICY(priority=0, noreply=False),
                )  # fmt: skip
                call = messages.REQUEST(header=header, parameter=json.dumps(parameter), binary=[])
                self._requests.write(call)
            for answer in latest(self._responses):
                if answer.header.identity.id in numbers:
                    if code := answer.header.status.code:
                        raise DriverError(f"motion_switcher: call {api} fails with code {code}")
                    return str(answer.data)
            time.sleep(0.002)
        raise DriverError(
            f"motion_switcher does not answer call {api} within {PATIENCE:g} s; its service runs in the robot"
        )


class SwitcherServer:
    """The service, for a served robot."""

    def __init__(self, node: UnitreeNode) -> None:
        self.name = NAME
        """Name of the controller that runs; empty without one."""
        self._requests = node.reader(
            "rt/api/motion_switcher/request", messages.REQUEST, keep=MOST, reliable=True
        )
        self._responses = node.writer("rt/api/motion_switcher/response", messages.RESPONSE, keep=MOST)

    def poll(self) -> None:
        """Answers the calls that have arrived."""
        for call in latest(self._requests):
            code, data = self._answer(call.header.identity.api_id, call.parameter)
            if not call.header.policy.noreply:
                header = messages.RESPONSE_HEADER(
                    identity=call.header.identity, status=messages.STATUS(code=code)
                )
                self._responses.write(messages.RESPONSE(header=header, data=data, binary=[]))

    def _answer(self, api: int, parameter: str) -> tuple[int, str]:
        if api == CHECK:
            return 0, json.dumps({"form": "0", "name": self.name})
        if api == RELEASE:
            self.name = ""
            return 0, ""
        if api == SELECT:
            wanted: Any = None
            with suppress(ValueError, KeyError, TypeError):
                wanted = json.loads(parameter)["name"]
            if wanted != NAME:
                return BAD, ""
            self.name = NAME
            return 0, ""
        return UNKNOWN, ""
