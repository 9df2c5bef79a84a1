"""XELA's sensors through a stand-in of the maker's server, of which no second author has a client."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from helpers.touch_devices import Xela
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


def test_a_server_without_sensors_is_told(server: Xela) -> None:
    server.message = lambda: {"message": 1}  # type: ignore[method-assign]
    with pytest.raises(DriverError, match="tells no sensor"):
        source_at(server.via)
