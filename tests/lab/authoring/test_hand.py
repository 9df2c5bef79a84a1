"""A hand described by what it sends: places by Inspire's manual, and a touch that shows there."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tci
from helpers.serial_devices import Anyskin
from helpers.touch_devices import InspireHand
from tci.cli.main import app
from tci.errors import DriverError
from tci.recording.recording import Recording

pytestmark = pytest.mark.timeout(120)


@pytest.fixture(scope="module")
def hand() -> Iterator[InspireHand]:
    made = InspireHand()
    made.plug()
    time.sleep(0.1)
    yield made
    made.unplug()


@pytest.fixture(scope="module")
def described(hand: InspireHand, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hands") / "mine"
    said = CliRunner().invoke(app, ["hand", hand.via, "--describe", str(folder)], env={"COLUMNS": "300"})
    assert said.exit_code == 0, said.output
    assert f'tci view {folder / "hand.xml"} --via "sim + {hand.via}"' in said.stdout
    with pytest.raises(DriverError, match="exists"):
        CliRunner().invoke(app, ["hand", hand.via, "--describe", str(folder)], catch_exceptions=False)
    return folder / "hand.xml"


def test_pads_lie_as_on_a_hand_and_values_as_in_the_manual(described: Path) -> None:
    robot = tci.load_robot(described)
    with tci.connect(robot, "sim") as driver:
        joints = driver.read().joints
    skin = tci.GenericBody(robot).skin
    places = {patch.name: skin.positions(patch.name, joints, frame="torso") for patch in robot.skin}
    assert sum(map(len, places.values())) == 1062
    palm, top = places["palm"], places["index_top"]
    right, away = np.array([1, 0, 0]), np.array([0, 1, 0])
    # palm: value 1 is row 8 column 1, value 8 row 1, value 9 column 2; fingers row by row from the far end
    assert np.ptp(palm @ right) == pytest.approx(50.2e-3 * 13 / 14, abs=1e-4)
    assert np.ptp(palm @ away) == pytest.approx(30.4e-3 * 7 / 8, abs=1e-4)
    assert (palm[7] - palm[0]) @ away > 0.02
    assert (palm[8] - palm[0]) @ right == pytest.approx(50.2e-3 / 14, abs=1e-4)
    assert (top[7] - top[0]) @ right > 0.008
    assert (top[0] - top[88]) @ away > 0.01
    assert places["index_tip"].mean(0) @ away > top.mean(0) @ away > places["index_pad"].mean(0) @ away
    fingers = [places[f"{one}_tip"].mean(0) @ right for one in ("thumb", "index", "middle", "ring", "little")]
    assert fingers == sorted(fingers)
    boxes = [(one[:, :2].min(0), one[:, :2].max(0)) for one in places.values()]
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:k]:
            assert (low > other_high).any() or (high < other_low).any(), "pads overlap"


def test_a_touch_shows_where_it_is_and_is_recorded(
    described: Path, hand: InspireHand, tmp_path: Path
) -> None:
    robot = tci.load_robot(described)
    with tci.connect(robot, f"sim + {hand.via}") as driver:
        perceiver, end, found = tci.Perceiver(tci.GenericBody(robot)), time.monotonic() + 10.0, ()
        perceiver.step(driver.read(), driver.clock.now())
        hand.values["palm"][7] = 2000
        while not found and time.monotonic() < end:
            now = driver.clock.now()
            found = perceiver.step(driver.read(), now).contacts
            driver.clock.sleep_until(now + 0.02)
    (contact,) = found
    assert contact.patch == "palm"
    assert contact.p_L[:2] == pytest.approx([-50.2e-3 * 6.5 / 14, 30.4e-3 * 3.5 / 8], abs=1e-4)
    file = tmp_path / "touch.mcap"
    command = ["record", str(file), str(described), "--via", f"sim + {hand.via}", "--duration", "0.5"]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert {frame.patch: frame.values.tolist() for frame in Recording(file).frames()} == hand.values


def test_several_values_for_a_point_are_no_skin(tmp_path: Path) -> None:
    device = Anyskin()
    device.plug()
    try:
        command = ["hand", device.via, "--describe", str(tmp_path / "new")]
        with pytest.raises(DriverError, match="axes=z"):
            CliRunner().invoke(app, command, catch_exceptions=False)
        command = ["hand", f"{device.via},axes=z", "--describe", str(tmp_path / "new")]
        assert CliRunner().invoke(app, command).exit_code == 0
        assert [patch.channels for patch in tci.load_robot(tmp_path / "new/hand.xml").skin] == [5]
    finally:
        device.unplug()
