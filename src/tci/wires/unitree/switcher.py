"""Client and server of `motion_switcher`, the service that switches the robot's own controller on and off."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from typing import Any

from tci.errors import DriverError
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages

CHECK, SELECT, RELEASE = 1001, 1002, 1003
"""Numbers by which the service identifies its calls."""
UNKNOWN, BAD = 3203, 3204
"""Error codes in answers. UNKNOWN: the server does not have this call. BAD: the call's parameter is
invalid."""
PATIENCE = 3.0
"""Longest time [s] to wait for an answer. Assumed: a connected service answers within milliseconds."""
TRIES = 5
"""Largest number of release calls. If the controller is still on after these calls, another program probably
keeps it on. Assumed: usually one call is enough."""
NAME = "ai"
"""Name of the robot's own controller, which walks and balances."""


class Switcher:
    """Client of the service `motion_switcher`."""

    def __init__(self, node: InterfaceNode) -> None:
        self._responses = node.reader(
            "rt/api/motion_switcher/response", messages.RESPONSE, keep=MOST, reliable=True
        )
        self._requests = node.writer("rt/api/motion_switcher/request", messages.REQUEST)

    def check(self) -> str:
        """Returns the name of the controller that runs. The name is empty if no controller runs. Raises
        DriverError if the service does not answer."""
        data = self._call(CHECK, {})
        try:
            return str(json.loads(data)["name"])
        except (ValueError, KeyError, TypeError) as error:
            raise DriverError(f"motion_switcher: {data[:80]!r} as an answer; valid: a name") from error

    def release(self) -> None:
        """Switches the robot's own controller off. The legs then no longer carry the robot.

        Raises DriverError if the controller stays on or the service does not answer.
        """
        for _ in range(TRIES):
            if not (name := self.check()):
                return
            self._call(RELEASE, {})
        raise DriverError(f"motion_switcher: the robot's controller {name} stays on after {TRIES} releases")

    def _call(self, api: int, parameter: dict[str, str]) -> str:
        """Calls the function `api` of the service motion_switcher, repeatedly until an answer arrives, and
        returns the data of the answer.

        Raises DriverError if the call fails or no answer arrives in time.
        """
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
    """Server of the service `motion_switcher` for a served robot."""

    def __init__(self, node: InterfaceNode) -> None:
        self.name = NAME
        """Name of the controller that runs. The text is empty if no controller runs."""
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
