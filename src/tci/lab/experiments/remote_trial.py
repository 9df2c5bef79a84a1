"""Runs the reflex of a trial in another process, which reaches the simulated robot through a middleware.

Robot, gate and finger are in this process. This process serves the robot in real time, as the command `tci
serve` does. The reflex has only the data that the middleware transports. Both processes run with real-time
priority if the system permits this priority (`real_time`), so that other programs do not affect the measured
times.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from tci.capabilities.capability import Capability
from tci.drivers.combined_server import JOIN
from tci.drivers.driver import Driver
from tci.drivers.registry import connect, open_server
from tci.drivers.simulated import SimulatedDriver
from tci.drivers.wrapper import DriverWrapper
from tci.errors import DriverError
from tci.messages import CONTROL_MODES, Order, PlatformCommand
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.runtime.priority import real_time_where_permitted
from tci.runtime.serve import serve
from tci.simulation.world import World

DONE, NUMB = "done", "done without skin"
"""Last message of the other process for a poke: a frame of skin arrived, or none did."""
STARTING = 60.0
"""Longest time [s] in which the other process must start, compile and connect. Assumed: the first compilation
needs about half of this time on two cores."""
ENDED = "ended"
"""Text that `_hear` returns instead of a message if the other process has ended."""
APPEARING = 10.0
"""Longest time [s] until a connection to the served robot is possible. Assumed: discovery over the slowest
middleware needs a few seconds."""


class TrialDriver(DriverWrapper):
    """Simulation in real time whose loop ends at the time `until`. The time `until` may be set while the loop
    runs."""

    until = float("inf")
    """Time [s] at which the loop ends."""

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        for now in super().ticks(duration=duration, start=start):
            if now >= self.until - 1e-9:
                return
            yield now


def try_server(robot: Robot, via: str) -> None:
    """Opens and closes a server, so that a missing requirement of the middleware is reported before the first
    trial.

    Raises MissingExtraError if the middleware's library is missing. Raises DriverError if the middleware
    needs a ROS master, a name server or a free port, and there is none.
    """
    with SimulatedDriver(robot) as driver, open_server(driver, via):
        pass


class RemoteTrial:
    """Another process that runs a reflex for one robot, for any number of pokes."""

    def __init__(self, robot: Robot, via: str, reflex: Capability[Any]) -> None:
        """Starts the other process, which runs `reflex`.

        `via` is the middleware as NAME or NAME:ADDRESS, like the argument of `tci serve`. Raises
        UnknownNameError if the robot has no binding to this middleware.
        """
        self.robot, self.via = robot, via
        for one in via.split(JOIN):
            robot.binding(one.partition(":")[0])
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=answer, args=(robot, reflex, theirs), daemon=True)
        self._process.start()
        theirs.close()

    def run(self, world: World, duration: float, trial: Trial) -> None:
        """Serves `world` until the reflex in the other process is ready, then runs the trial for `duration`
        [s].

        Raises DriverError if the other process reports an error or ends.
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
                # The finger starts at a new skin frame, so that the delays equal those of trials within one
                # process.
                before, frames = frames, tuple(frame.sequence for frame in tick.reading.skin)
                if ready and (frames != before or not frames):
                    driver.until = tick.now + duration + driver.period
                    trial.begin(tick.now)

            serve(server, observe=see)
            # The message is sent before the server closes, so that the reflex stops before the robot
            # disappears.
            self._tell("enough")
        said = ""
        while said not in (DONE, NUMB):
            said = self._hear(STARTING)
            if said in ("", ENDED):
                raise DriverError(self._trouble(said or f"no answer for {STARTING:g} s"))
        if said == NUMB and self.robot.skin:
            raise DriverError(
                f"{self.via} carries no skin of {self.robot.name}: the reflex got joints only, and can't "
                f'answer; valid: a middleware with skin beside it, such as --via "{self.via}{JOIN}yarp"'
            )

    def _ask(self, via: str) -> None:
        while self._hear(0.0) not in ("", ENDED):
            pass
        self._tell(via)

    def _tell(self, words: str) -> None:
        try:
            self._pipe.send(words)
        except OSError as error:
            raise DriverError(self._trouble(ENDED)) from error

    def _hear(self, wait: float) -> str:
        """Waits up to `wait` [s] for a message of the other process.

        Returns the message, an empty text if there is none, or ENDED if the process has ended.
        """
        try:
            return str(self._pipe.recv()) if self._pipe.poll(wait) else ""
        except (EOFError, OSError):
            return ENDED

    def _trouble(self, said: str) -> str:
        return f"the process with the reflex, connected by {self.via}: {said}"

    def _ready(self, asked: float) -> bool:
        said = self._hear(0.0)
        if said == "ready":
            return True
        if said or time.monotonic() - asked > STARTING:
            raise DriverError(self._trouble(said or f"no answer for {STARTING:g} s"))
        return False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.join()
        self._pipe.close()


class Trial:
    """Base class of trials. The control loop calls the methods."""

    def begin(self, now: float) -> None:
        """Begins the trial at `now` [s], after the reflex has become ready."""
        raise NotImplementedError

    def see(self, tick: Tick) -> None:
        """Records one period of the trial."""
        raise NotImplementedError


def part_of(robot: Robot, order: Order) -> str | None:
    """Returns the generic part that an order from another process moves.

    Returns None if the order moves nothing, and an empty text if the moved servos belong to no part.
    """
    if not isinstance(order, PlatformCommand) or order.mode not in CONTROL_MODES:
        return None
    wanted = set(order.servos.tolist())
    for part in robot.parts:
        if wanted & {servo.servo for servo in part.servos}:
            return part.name
    return ""


def _patiently(robot: Robot, via: str) -> Driver:
    """Connects to a robot that may still be starting: tries again for some seconds.

    Raises DriverError if all attempts fail.
    """
    end = time.monotonic() + APPEARING
    while True:
        try:
            return connect(robot, via, arm=True)
        except DriverError:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)


def answer(robot: Robot, reflex: Capability[Any], pipe: Connection) -> None:
    """Main loop of the other process.

    In each turn, the loop receives an address, connects to the robot at this address, and runs the reflex
    until the next message arrives.
    """
    while True:
        try:
            via = pipe.recv()
        except EOFError:
            return
        ticks, feels = 0, False

        def tell(tick: Tick) -> None:
            nonlocal ticks, feels
            ticks += 1
            feels = feels or bool(tick.reading.skin)
            if ticks == 1:
                pipe.send("ready")

        try:
            with real_time_where_permitted(), _patiently(robot, via) as driver:
                run(driver, reflex, until=lambda memory: pipe.poll(), observe=tell)
        except Exception as error:
            pipe.send(f"{type(error).__name__}: {error}".replace("\n", "; "))
        pipe.recv()
        pipe.send(DONE if feels else NUMB)
