"""For every failure in yarpwire, the methods of driver and server raise only errors of TCI."""

from __future__ import annotations

import contextlib
import inspect
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.patient import patient
from helpers.yarp_show import Show, until
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, MissingExtraError, TciError
from tci.messages import Mode, Perception, PlatformSwitch
from tci.wires.yarp.address import YarpAddress
from tci.wires.yarp.driver import YarpDriver
from tci.wires.yarp.driver_errors import raises_driver_errors
from tci.wires.yarp.server import YarpServer
from yarpwire import errors
from yarpwire.dialect import V3
from yarpwire.errors import BindingsError, PortError, UnknownNameError, YarpError
from yarpwire.network import Caller, NamedPort, Network, Writer

pytestmark = [
    pytest.mark.timeout(180),
    pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning"),
]
RETURNS: dict[str, type[Any]] = {"port": NamedPort, "writer": Writer, "caller": Caller}
"""Interface of the object that each method of the network returns."""
CALLS = [
    f"{interface.__name__}.{name}"
    for interface in (Network, *RETURNS.values())
    for name, _ in inspect.getmembers(interface, inspect.isfunction)
    if not name.startswith("_")
]
"""All methods of yarpwire's networks that driver and server may call."""
OF_SERVER = {"NamedPort.write"}
"""Calls that only the server makes."""


class Case:
    """One call that fails, from the first call or from a later call on."""

    def __init__(self, call: str) -> None:
        self.call = call
        self.armed = self.reached = False
        self.said: list[TciError] = []
        self.opened: list[Any] = []
        """Ports, writers and callers that were opened. They are closed at the end, because objects whose
        `close` fails stay open."""

    def look(self, call: str) -> None:
        if self.armed and call == self.call:
            self.reached = True
            raise PortError(f"{call} fails")

    def attempt(self, act: Callable[[], object]) -> None:
        """Runs `act`. Accepts only errors of TCI."""
        try:
            act()
        except TciError as error:
            self.said.append(error)


class Failing:
    """A network, or an object that its methods return. The call of the case raises an error; all other calls
    work."""

    def __init__(self, inner: Any, interface: type[Any], case: Case) -> None:
        self._inner, self._interface, self._case = inner, interface, case

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        if not inspect.ismethod(found):
            return found

        def made(*args: Any, **kwargs: Any) -> Any:
            self._case.look(f"{self._interface.__name__}.{name}")
            result = found(*args, **kwargs)
            interface = RETURNS.get(name) if self._interface is Network else None
            if interface is None:
                return result
            self._case.opened.append(result)
            return Failing(result, interface, self._case)

        return made


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Show]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
        running = Show(V3)
        yield running
        running.close()


@pytest.fixture(params=CALLS)
def case(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Case]:
    """Returns a case. All networks that are opened during the test fail as the case says."""
    found, network = Case(request.param), YarpAddress.network
    monkeypatch.setattr(
        YarpAddress, "network", raises_driver_errors(lambda self: Failing(network(self), Network, found))
    )
    yield found
    for one in found.opened:
        with contextlib.suppress(YarpError):
            one.close()


def where(show: Show) -> str:
    return "{}:{}".format(*show.names.address)


def use(driver: YarpDriver, case: Case) -> None:
    """Calls every public method of a driver."""
    servo = driver.robot.servos[0]
    switch = PlatformSwitch(servos=np.array([servo.index]), mode=Mode.IMPEDANCE)
    command = driver.native(servo.robot_part).command({servo.name: 0.0})
    for act in (driver.skin_events, driver.diagnose, driver.read):
        case.attempt(act)
    for order in (command, switch, command):
        for _ in range(5):
            safe = driver.gate.step([order], driver.read().joints, driver.clock.now())
            case.attempt(lambda safe=safe: driver.write(safe))
            time.sleep(driver.period)
    case.attempt(driver.halt)


def test_a_driver_raises_no_other_errors(show: Show, case: Case) -> None:
    robot = patient("nao")
    case.armed = True
    with contextlib.suppress(TciError):
        YarpDriver(robot, where(show), arm=True).close()
    for finding in YarpDriver.probe(robot, where(show)):
        assert finding.what
    case.armed = False
    driver = YarpDriver(robot, where(show), arm=True)
    show.names.unregister(next(iter(driver.skin.values())).port.name)
    case.armed = True
    use(driver, case)
    if case.call not in OF_SERVER:
        assert until(lambda: case.reached or case.call.endswith("close"))
    case.attempt(driver.close)
    assert case.reached or case.call in OF_SERVER


def test_a_server_raises_no_other_errors(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    inner = SimulatedDriver(patient("nao"))
    case.armed = True
    with contextlib.suppress(TciError):
        YarpServer(inner, "127.0.0.1:0").close()
    case.armed = False
    server = YarpServer(inner, "127.0.0.1:0")
    case.armed = True
    reading = inner.read()
    perception = Perception(0.0, {}, ())
    sent = inner.gate.step([], reading.joints, inner.clock.now())
    for act in (lambda: server.show(reading), lambda: server.publish(reading, perception, sent)):
        case.attempt(act)
    part = next(iter(server.boards))
    for act in (lambda: server.close_board(part), lambda: server.open_board(part), server.close):
        case.attempt(act)
    assert case.reached or case.call not in OF_SERVER


@pytest.mark.parametrize(
    "kind", [kind for kind in vars(errors).values() if inspect.isclass(kind) and issubclass(kind, YarpError)]
)
def test_each_error_becomes_a_driver_error_with_its_text(kind: type[YarpError]) -> None:
    made: dict[type[YarpError], tuple[Any, ...]] = {
        UnknownNameError: ("port", "/a", ["/b"]),
        BindingsError: ("yarp", "conda has it"),
    }
    error = kind(*made.get(kind, ("the reason",)))

    @raises_driver_errors
    def fails() -> None:
        raise error

    with pytest.raises(MissingExtraError if kind is BindingsError else DriverError) as found:
        fails()
    assert found.value.__cause__ is error
    assert kind is BindingsError or str(found.value) == str(error)
