"""A poke whose reflex runs in another process, and reaches the simulated robot through a middleware.

The robot, its gate and the finger are here, served as `tci serve` serves them, in real time; the reflex there
knows nothing but what the middleware brings. Both go before other programs where the system permits it
(`real_time`), as on a robot: what they take is told, not what else runs on the machine.
"""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from tci.authoring.dense_skin import with_skin_rate
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.driver import Driver
from tci.drivers.registry import connect, open_server
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import DriverError
from tci.messages import CONTROL_MODES, Mode, Order, PlatformCommand
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.runtime.real_time import real_time_where_permitted
from tci.runtime.serve import serve
from tci.simulation.world import World

STARTING = 60.0
"""Time [s] that the other process has to be there, compile and connect. Ours."""
APPEARING = 10.0
"""Time [s] that the served robot has to answer whoever connects. Ours."""


class TrialDriver(DriverWrapper):
    """A simulation in real time whose loop ends at a time that is known only later."""

    until = float("inf")
    """When [s]."""

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        for now in super().ticks(duration=duration, start=start):
            if now >= self.until - 1e-9:
                return
            yield now


def try_server(robot: Robot, via: str) -> None:
    """Opens and closes a server, so that what is missing is told before any trial.

    Raises MissingExtraError without its library, DriverError without what it needs: a master, a name server,
    a free port.
    """
    with SimulatedDriver(robot) as driver, open_server(driver, via):
        pass


class RemoteTrial:
    """The other process, with the withdrawal reflex for one robot. It serves any number of pokes."""

    def __init__(self, robot: Robot, via: str, mode: Mode) -> None:
        """`via` as `tci serve` takes it. Raises UnknownNameError for a robot without a binding to it."""
        self.robot, self.via = robot, via
        rates = {str(patch.rate) for patch in robot.patches}
        rate = rates.pop() if len(rates) == 1 else ""
        name = via.partition(":")[0]
        silence = str(robot.binding(name).stale_after)
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, robot.source, mode.value, rate, name, silence],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._said: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._said.put(line.strip())
        self._said.put("ended")

    def run(self, world: World, duration: float, trial: Trial) -> None:
        """Serve `world` until the reflex there is ready, then for `duration` [s] of the trial.

        Raises DriverError when the other process says that it can't, or ends.
        """
        driver = TrialDriver(SimulatedDriver(world.robot, world=world, paced=True))
        asked = time.monotonic()
        with real_time_where_permitted(), open_server(driver, self.via) as server:
            self._ask(server.reach())

            ready = False
            frames: tuple[int, ...] | None = None

            def see(tick: Tick) -> None:
                nonlocal ready, frames
                if driver.until < float("inf"):
                    trial.see(tick)
                    return
                ready = ready or self._ready(asked)
                # The finger leaves with a new frame of the skin, as it does where the reflex is here.
                before, frames = frames, tuple(frame.sequence for frame in tick.reading.skin)
                if ready and (frames != before or not frames):
                    driver.until = tick.now + duration + driver.period
                    trial.begin(tick.now)

            serve(server, observe=see)
            self._tell("enough")  # while the robot is there: nobody misses anybody
        said = ""
        while said != "done":
            said = self._said.get(timeout=STARTING)
            if said == "ended":
                raise DriverError(self._trouble(said))

    def _ask(self, line: str) -> None:
        while not self._said.empty():
            self._said.get()
        self._tell(line)

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        try:
            print(line, file=self._process.stdin, flush=True)
        except BrokenPipeError as error:
            raise DriverError(self._trouble("ended")) from error

    def _trouble(self, said: str) -> str:
        return f"the reflex in another process, {self.via}: {said}"

    def _ready(self, asked: float) -> bool:
        try:
            said = self._said.get_nowait()
        except queue.Empty:
            said = ""
        if said == "ready":
            return True
        if said or time.monotonic() - asked > STARTING:
            raise DriverError(self._trouble(said or "it does not answer"))
        return False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()


class Trial:
    """What a poke does with the ticks of its loop."""

    def begin(self, now: float) -> None:
        """The reflex is ready."""
        raise NotImplementedError

    def see(self, tick: Tick) -> None:
        """A tick after that."""
        raise NotImplementedError


def part_of(robot: Robot, order: Order) -> str | None:
    """The generic part that an order from elsewhere moves; None for one that moves nothing."""
    if not isinstance(order, PlatformCommand) or order.mode not in CONTROL_MODES:
        return None
    wanted = set(order.servos.tolist())
    for part in robot.parts:
        if wanted & {servo.servo for servo in part.servos}:
            return part.name
    return ""


def _patiently(robot: Robot, via: str) -> Driver:
    """A driver of a robot that may just be starting."""
    end = time.monotonic() + APPEARING
    while True:
        try:
            return connect(robot, via, arm=True)
        except DriverError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def main() -> None:
    """The other process: told an address it connects and runs the reflex, until it is told anything more."""
    source, mode, rate, name, silence = sys.argv[1:]
    robot = load_robot(source)
    bindings = tuple(
        binding.model_copy(update={"stale_after": float(silence)}) if binding.middleware == name else binding
        for binding in robot.bindings
    )
    robot = robot.model_copy(update={"bindings": bindings})
    if rate:
        robot = with_skin_rate(robot, float(rate))
    reflex = WithdrawalReflex(mode=Mode(mode))
    told: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_hear, args=(told,), daemon=True).start()
    while via := told.get():
        ticks = 0

        def tell(tick: Tick) -> None:
            nonlocal ticks
            ticks += 1
            if ticks == 1:
                print("ready", flush=True)

        try:
            with real_time_where_permitted(), _patiently(robot, via) as driver:
                run(driver, reflex, until=lambda memory: not told.empty(), observe=tell)
        except Exception as error:
            print(f"{type(error).__name__}: {error}".replace("\n", "; "), flush=True)
        told.get()
        print("done", flush=True)


def _hear(told: queue.Queue[str]) -> None:
    for line in sys.stdin:
        told.put(line.strip())
    told.put("")


if __name__ == "__main__":
    main()
