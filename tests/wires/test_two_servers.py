"""Two processes that serve one robot in the same place hear each other, and both say so."""

from __future__ import annotations

import uuid
from contextlib import ExitStack

import pytest

import tci
from helpers.wire_peers import lcm_url
from tci.body.generic_body import GenericBody
from tci.drivers.registry import open_server
from tci.drivers.simulated import SimulatedDriver


@pytest.mark.parametrize("wire", ["lcm", "ros2"])
def test_two_servers_of_one_robot_both_tell_it(wire: str, caplog: pytest.LogCaptureFixture) -> None:
    robot = tci.load_robot("nao")
    via = f"lcm:{lcm_url()}" if wire == "lcm" else f"ros2:/{'x' + uuid.uuid4().hex[:8]}"
    with ExitStack() as closing:
        drivers = [closing.enter_context(SimulatedDriver(robot, paced=True)) for _ in range(2)]
        servers = [closing.enter_context(open_server(driver, via)) for driver in drivers]
        perceiver = tci.Perceiver(GenericBody(robot))
        now = drivers[0].clock.now()

        def told() -> list[str]:
            return [one for one in caplog.messages if one.startswith("another process serves nao as")]

        while len(told()) < 2 and drivers[0].clock.now() - now < 20.0:
            for driver, server in zip(drivers, servers, strict=True):
                reading = driver.read()
                server.fault()
                sent = driver.gate.step((), reading.joints, driver.clock.now())
                server.publish(reading, perceiver.step(reading, driver.clock.now()), sent)
                driver.clock.sleep_until(driver.clock.now() + 0.01)
    assert len(told()) == 2
    assert all("valid: end one of them" in one for one in told())
