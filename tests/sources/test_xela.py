"""XELA's sensors through a stand-in of the maker's server, of which no second author has a client."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tci
from helpers.touch_devices import Xela
from tci.cli.main import app
from tci.drivers.registry import source_at
from tci.drivers.source_reader import SourceReader
from tci.errors import DriverError

pytestmark = pytest.mark.timeout(60)
pytest.importorskip("websockets", reason="did not run: needs websockets; to get it: make test")


@pytest.fixture
def server() -> Iterator[Xela]:
    made = Xela()
    made.number()
    made.plug()
    yield made
    made.unplug()


def read(via: str) -> dict[str, list[float]]:
    source = source_at(via)
    reader = SourceReader(via, source, source.pads)
    reader.wait(3.0)
    found = {pad: state.values.tolist() for pad, state in reader.pads.items() if state.values is not None}
    reader.close()
    return found


def test_values_are_raw_or_calibrated_along_one_axis_or_three(server: Xela) -> None:
    three = read(f"{server.via},axes=xyz")
    assert {pad: values[2::3] for pad, values in three.items()} == server.values
    assert three["sensor_1"][:2] == [32768, 14256]
    newtons = read(f"{server.via},values=calibrated")
    assert newtons["sensor_3"] == pytest.approx([value / 100 for value in server.values["sensor_3"]])


def test_sensors_of_16_and_24_taxels_lie_in_rows_and_a_pressed_corner_shows_there(
    server: Xela, tmp_path: Path
) -> None:
    server.values = {pad: [32768] * len(values) for pad, values in server.values.items()}
    said = CliRunner().invoke(app, ["hand", server.via, "--describe", str(tmp_path / "grip")])
    assert said.exit_code == 0, said.output
    robot = tci.load_robot(tmp_path / "grip" / "hand.xml")
    tables = {
        patch: np.loadtxt(tmp_path / "grip" / f"{patch}.csv", delimiter=",", skiprows=1)[:, 1:3]
        for patch in ("sensor_1", "sensor_3")
    }  # [mm], x to the right and y away from the wrist
    assert tables["sensor_1"][[0, 3, 12]] == pytest.approx(
        np.array([[-7.05, 7.05], [7.05, 7.05], [-7.05, -7.05]])
    )
    assert tables["sensor_3"][[0, 5, 18]] == pytest.approx(
        np.array([[-11.75, 7.05], [11.75, 7.05], [-11.75, -7.05]])
    )
    with tci.connect(robot, f"sim + {server.via}") as driver:
        perceiver, found = tci.Perceiver(tci.GenericBody(robot)), list[tci.Contact]()
        perceiver.step(driver.read(), driver.clock.now())
        server.values["sensor_3"][5] += 20000
        for now in driver.ticks(duration=10.0):
            found = [*perceiver.step(driver.read(), now).contacts]
            if found:
                break
    (contact,) = found
    assert (contact.patch, contact.p_L[:2]) == ("sensor_3", pytest.approx([0.01175, 0.00705]))
    via = f"{server.via},values=calibrated"
    said = CliRunner().invoke(app, ["hand", via, "--describe", str(tmp_path / "newtons")])
    assert said.exit_code == 0, said.output
    sensor = tci.load_robot(tmp_path / "newtons" / "hand.xml").skin[0].sensor
    assert sensor.pascal_per_count == pytest.approx(1 / 4.7e-3**2, rel=1e-4), (
        "a count is a newton on 4.7 x 4.7 mm"
    )


def test_a_server_without_sensors_is_told(server: Xela) -> None:
    server.message = lambda: {"message": 1}  # type: ignore[method-assign]
    with pytest.raises(DriverError, match="tells no sensor"):
        source_at(server.via)
