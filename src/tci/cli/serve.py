"""`tci serve`: lets other programs read and command a robot. The gate of this process checks the commands of
these programs."""

from __future__ import annotations

import shlex
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.options import Arm, AsJson, Duration, RobotName, Touches, TouchFile

if TYPE_CHECKING:
    from tci.runtime.loop import Tick

REFLEX = "withdrawal"


def serve(
    robot: RobotName,
    via: Annotated[
        str,
        typer.Option(
            help="Middleware over which other programs connect: NAME or NAME:ADDRESS.",
            autocompletion=completion.servers,
        ),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            help="Driver that connects this process to the robot: NAME or NAME:ADDRESS.",
            autocompletion=completion.drivers,
        ),
    ] = "sim",
    arm: Arm = False,
    touch: Touches = None,
    touches: TouchFile = None,
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Let other programs read and command a real or simulated robot. The gate of this process checks all
    commands. A real robot moves only with --arm. Without --arm, the other programs can only read the robot's
    data. The exit status is 1 if the gate is stopped at the end. While it runs, type reset or free.

    With --touch or --touches, people touch a simulated robot again and again, so that behaviours of other
    programs can be tried. tci touch does it once, when you say so.

    Example:  tci serve nao --via zenoh

    Example:  tci serve nao --via zenoh --touch "stroke 'left forearm' 3N 8cm/s"
    """
    from tci.capabilities.capability import lacks
    from tci.cli.operator import HINT, Operator
    from tci.cli.pace import Pace
    from tci.cli.touch_desk import TouchDesk
    from tci.cli.touching import ask, example_touch
    from tci.drivers.info import moves_nothing_real
    from tci.drivers.registry import connect, open_server
    from tci.drivers.simulated import SimulatedDriver
    from tci.errors import DriverError
    from tci.gate.gate import GateState
    from tci.reasons import OTHERS, Code, Reason, ReasonCounter
    from tci.robot.catalogue import load_robot
    from tci.runtime.arguments import capabilities_for, load_capability
    from tci.runtime.loop_report import LoopReport
    from tci.runtime.serve import Served
    from tci.runtime.serve import serve as serve_robot

    described = load_robot(robot)
    asked = ask(described, touch or [], touches)
    options: dict[str, Any] = {}
    if source == "sim":  # people who wait do not change what the skin feels of the robot itself
        options = {"paced": True, "people": 1} | ({"self_touch": False} if asked is None else {})
    options |= {} if asked is None else asked.options(source)
    fits = REFLEX
    if not as_json and lacks(load_capability(REFLEX), described):
        fits = next(iter(capabilities_for(described)), REFLEX)
    arm = arm or moves_nothing_real(source)
    report, served, reasons = LoopReport(), Served(), ReasonCounter()
    opened = connect(described, source, arm=arm, **options)
    with opened as driver, open_server(driver, via) as server, told_here(), ExitStack() as closing:
        world = driver.world if isinstance(driver, SimulatedDriver) else None
        # it tries with the hands that a client of the desk would use
        example = example_touch(world) if world and not as_json and asked is None else ""
        desk, unreachable = None, ""
        try:
            desk = closing.enter_context(TouchDesk(driver, via, source))
        except DriverError as error:
            unreachable = f"tci touch can't reach this robot: {error}"
        if not as_json:
            words = f"serving {driver.robot.name} as {server.where()}; end with Ctrl-C"
            console.print(words, highlight=False, markup=False)
            run = ["tci", "run", fits, robot, "--via", server.reach()]
            words = shlex.join([*run, "--arm"] if source == "sim" else run)
            words = f"to use it, in another terminal: {words}"
            console.print(words, style="dim", highlight=False, markup=False, soft_wrap=True)
        if unreachable and not as_json:
            console.print(unreachable, style="dim", highlight=False, markup=False)
        if desk and example:
            wire = via.partition(":")[0]
            words = f'to touch it, in another terminal: tci touch {robot} --via {wire} "{example}"'
            console.print(words, style="dim", highlight=False, markup=False, soft_wrap=True)

        operator, pace = Operator(driver.gate), Pace(driver.clock)
        stopped = False
        if asked is not None and not as_json:
            asked.tell()
        again, zero = -1.0, None

        def see(tick: Tick) -> None:
            nonlocal stopped, again, zero
            zero = tick.now if zero is None else zero
            since = f"{tick.now - zero:10.3f} s"  # a real robot's clock begins anywhere
            if desk is not None:
                desk.see(tick)
            if asked is not None and tick.now > again:
                asked.begin(driver)
                again = tick.now + asked.end
            for words in (*operator.listen(), *pace.listen(tick.now)):
                if not as_json:
                    console.print(f"{since}  {words}", highlight=False, markup=False)
            if tick.sent.state is GateState.STOP and not stopped and operator.present:
                console.print(HINT, style="dim", highlight=False)
            stopped = tick.sent.state is GateState.STOP
            words = (
                f"{tick.sent.state.name}: {tick.sent.reason}" if tick.sent.reason else tick.sent.state.name
            )
            met = (f"CONTACT: {one}" for one in tick.sent.clamped if one.code is Code.CONTACT)
            for line in (words, *met, *map(str, tick.sent.refusals)):
                if reasons.add(Reason.of(line), tick.now) and not as_json:
                    console.print(f"{since}  {line}", highlight=False, markup=False)

        status = 0
        try:
            serve_robot(server, duration=duration, observe=see, report=report, served=served)
        except KeyboardInterrupt:
            pass
        except SystemExit as end:  # SIGTERM raises SystemExit
            status = int(end.code or 0)
        state = driver.gate.state
    if as_json:
        print_json(
            {
                "robot": robot,
                "via": via,
                "state": state.value,
                "orders": served.orders,
                "refusals": dict(served.refusals.counts),
                "overtaken": server.overtaken,
                "loop": report.to_json(),
                "speed": pace.speed(),
                **({} if asked is None else asked.to_json(driver)),
            }
        )
    else:
        refused = sum(served.refusals.counts.values())
        late = f", {server.overtaken} came as their part met something" if server.overtaken else ""
        console.print(
            f"{report.ticks} periods, {served.orders} orders, {refused} refused{late}; "
            f"at the end {state.name}",
            highlight=False,
        )
        if pace.late > 0.0:
            words = f"the simulation was late: it ran at {pace.speed():.2f} of real time"
            console.print(words, style="yellow", highlight=False)
        if left_out := reasons.counts[OTHERS]:
            console.print(f"{left_out} further messages ({OTHERS}) are not shown", highlight=False)
    if state is GateState.STOP and report.ended == "done":
        status = 1
    if status:
        raise SystemExit(status)
