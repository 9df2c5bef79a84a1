"""A recording is shown as views. A view does not depend on the order in which moments are shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.recorded import record_poke
from helpers.skin_data import SkinData
from tci.errors import CommandError, RecordingError
from tci.gate.gate import GateState
from tci.lab.viewer import player as player_module
from tci.lab.viewer.player import Player
from tci.messages.contacts import Contacts
from tci.recording.contact_list import import_contact_list
from tci.recording.perceived import Perceived, perceive, recorded_robot
from tci.recording.recording import Recording
from tci.runtime.loop import Tick


@pytest.fixture(scope="module")
def poked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Tick]]:
    path = tmp_path_factory.mktemp("player") / "poke.mcap"
    return path, record_poke(path)


@pytest.fixture
def player(poked: tuple[Path, list[Tick]]) -> Player:
    return Player(Recording(poked[0]), tci.load_robot("nao"))


def test_every_moment_is_shown_as_it_was(player: Player, poked: tuple[Path, list[Tick]]) -> None:
    ticks = poked[1]
    order = np.random.default_rng(0).permutation(len(ticks))
    touched = 0
    for tick in (ticks[index] for index in order):
        player.seek(tick.now)
        view = player.view
        assert tick.now - 0.01 - 1e-9 <= view.time <= tick.now
        shown = next(known for known in ticks if known.now == view.time)
        assert np.array_equal(view.joints.position, shown.reading.joints.position)
        assert [c.force for c in view.contacts] == [c.force for c in shown.perception.contacts]
        assert np.array_equal(
            view.pressure["left_forearm"],
            shown.skin.by_patch(patch.name for patch in player.robot.patches)["left_forearm"],
        )
        assert view.state is shown.sent.state is GateState.RUN
        touched += bool(view.contacts)
    assert touched > 3


def test_it_plays_pauses_and_ends(player: Player) -> None:
    player.advance(100.0)
    assert player.time == player.begin
    player.play()
    player.advance(100.0)
    player.advance(100.1)
    assert player.time == pytest.approx(player.begin + 0.1)
    player.speed = 2.0
    player.advance(100.2)
    assert player.time == pytest.approx(player.begin + 0.3)
    player.pause()
    player.advance(105.0)
    assert player.time == pytest.approx(player.begin + 0.3)
    player.play()
    player.advance(106.0)
    player.advance(110.0)
    assert player.time == player.end
    assert not player.playing
    player.play()
    assert player.time == player.begin


def test_plots_and_events_are_those_before_now(player: Player) -> None:
    player.seek(player.end)
    time, force, _, _ = player.history.series("left_arm")
    assert force.max() > 1.0
    words = [words for _, words in player.events]
    assert any(said.startswith("touched: left forearm") for said in words)
    assert any(said.startswith("left arm goes to") for said in words)
    player.seek(player.begin + 0.1)
    assert player.history.series("left_arm")[0][-1] <= player.begin + 0.1 + 1e-9
    assert player.events == []
    assert time[-1] > player.begin + 0.5


def test_at_the_begin_of_a_touch_it_is_shown(player: Player) -> None:
    assert player.touches
    for touch in player.touches:
        player.seek(touch.began)
        assert [contact.part for contact in player.view.contacts] == [touch.part]


def test_it_can_not_be_touched(player: Player) -> None:
    with pytest.raises(CommandError, match="recording"):
        player.poke(None, force=1.0, speed=0.1)


def test_what_is_too_long_is_told(poked: tuple[Path, list[Tick]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tci.lab.viewer.player.LONGEST", 0.2)
    with pytest.raises(RecordingError, match=r"longer than 0.2 s.*tci log cut"):
        Player(Recording(poked[0]), tci.load_robot("nao"))


def test_touches_of_an_icubs_contact_list_play(tmp_path: Path, skin_data: SkinData) -> None:
    path = tmp_path / "touches.mcap"
    log = skin_data.file("recordings/icub_skin_events.log")
    done = import_contact_list(log, path, tci.load_robot("icub"))
    periods = done.periods
    # The other contacts are on parts and modules that the model lacks.
    assert (periods, done.left_out) == skin_data.expect(made=(400, 380), genuine=(3479, 1024))
    recording = Recording(path)
    robot = recorded_robot(recording)
    assert robot is not None
    player = Player(recording, robot)
    assert player.end - player.begin == pytest.approx(0.02 * periods, rel=0.01)
    assert {touch.part for touch in player.touches} == {"left_arm", "right_arm"}
    player.seek(player.touches[-1].began)
    assert player.view.contacts
    assert player.view.state is None


def test_two_periods_of_one_time_are_one_event(
    poked: tuple[Path, list[Tick]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Contacts in contact lists may have equal time stamps. Here the second of two periods with equal stamps
    has no contact."""

    def twice(recording: Recording, robot: tci.Robot) -> Iterator[Perceived]:
        for period in perceive(recording, robot):
            yield period
            yield replace(period, perception=replace(period.perception, contacts=Contacts.of([])))

    monkeypatch.setattr(player_module, "perceive", twice)
    assert Player(Recording(poked[0]), tci.load_robot("nao")).touches
