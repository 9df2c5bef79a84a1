"""A NAO in a separate process. Autonomous life is on or off at the start. Tests kill and restart this
process."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

import psutil

from helpers import TESTS
from helpers.served import needs_qi


class LivingNao:
    """A NAOqi service in a separate process."""

    def __init__(self, life: str, port: int = 0, *, late: bool = False) -> None:
        """Starts with autonomous life in the state `life`. With `late`, autonomous life is available only
        after `go_on`."""
        needs_qi()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "helpers.living_nao", life, str(port), *(["late"] * late)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=TESTS,
        )  # fmt: skip
        self.port = int(self._await("port").split()[1])
        self.via = f"naoqi://127.0.0.1:{self.port}"

    def go_on(self) -> None:
        """Makes autonomous life available."""
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        self._await("complete")

    def life(self) -> str:
        """State of autonomous life, as clients read it."""
        import qi

        session = qi.Session()
        session.connect(f"tcp://127.0.0.1:{self.port}")
        try:
            return str(session.service("ALAutonomousLife").getState())
        finally:
            session.close()

    def kill(self) -> None:
        """Ends the process with SIGKILL."""
        self.process.kill()
        self.process.communicate()

    def _await(self, word: str) -> str:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith(word):
                return line
        raise AssertionError(f"it ended before it said {word!r}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()


def cut(port: int) -> None:
    """Shuts down each connection of this process to `port`. Touches no other socket: a Python object for the
    listening socket of rospy would make that socket non-blocking, and rospy's server would end."""
    for one in psutil.Process().net_connections("tcp"):
        if one.raddr and one.raddr.port == port:
            with suppress(OSError), socket.socket(fileno=os.dup(one.fd)) as found:
                found.shutdown(socket.SHUT_RDWR)


def _serve(life: str, port: str, late: bool) -> None:
    from helpers.still_nao import StillNao

    last: Any = ["ALMotion", "ALAutonomousLife"] if late else ["ALMotion"]
    with StillNao(port=int(port), without=tuple(last)) as nao:
        nao.services["ALAutonomousLife"].setState(life)
        nao.session.registerService("ALMotion", nao.services["ALMotion"])
        print("port", nao.port, flush=True)
        if late:
            sys.stdin.readline()
            nao.session.registerService("ALAutonomousLife", nao.services["ALAutonomousLife"])
            print("complete", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    _serve(sys.argv[1], sys.argv[2], "late" in sys.argv[3:])
