"""Recordings of different lengths, which are shown side by side at the same time."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
from viser import _messages

import tci
from helpers.recorded import record_poke
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.playback import Playback
from tci.lab.viewer.player import Player
from tci.recording.recording import Recording

PATIENCE = 40.0


@pytest.fixture(scope="module")
def players(tmp_path_factory: pytest.TempPathFactory) -> tuple[Player, Player]:
    """Two players. The first recording ends after 0.39 s, the second after 0.99 s. Both contain a touch after
    0.3 s."""
    folder: Path = tmp_path_factory.mktemp("lengths")
    record_poke(folder / "short.mcap", duration=0.4)
    record_poke(folder / "long.mcap", duration=1.0)
    robot = tci.load_robot("nao")
    short, long = (Player(Recording(folder / f"{name}.mcap"), robot) for name in ("short", "long"))
    return short, long


@pytest.fixture
def playback(players: tuple[Player, Player]) -> Iterator[Playback]:
    viewer = Viewer(players, port=0)
    assert viewer.playback is not None
    viewer.playback.seek(0.0)
    yield viewer.playback
    viewer.close()


def times(players: tuple[Player, Player]) -> list[float]:
    return [player.time - player.begin for player in players]


def updated(playback: Playback) -> None:
    """Updates, and waits until viser's thread has finished."""
    playback.update()
    asyncio.run_coroutine_threadsafe(asyncio.sleep(0), playback._server.get_event_loop()).result(PATIENCE)


def join(work: Callable[[], None]) -> None:
    """Runs `work` in another thread while the viewer continues."""
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()


def test_the_slider_follows_the_longest(playback: Playback, players: tuple[Player, Player]) -> None:
    playback.play_or_pause()
    for now in (100.0, 100.7):
        playback.advance(now)
    assert times(players) == pytest.approx([0.39, 0.7])
    updated(playback)
    assert playback.slider.value == pytest.approx(0.7)
    playback.seek(0.9)
    updated(playback)
    assert playback.slider.value == pytest.approx(0.9)


def test_a_time_that_a_person_sets_is_heard_before_the_slider_follows(
    playback: Playback, players: tuple[Player, Player]
) -> None:
    server, slider = playback._server, playback.slider
    server._connected_clients[0] = Mock()
    # The viewer's thread runs after viser has stored the new value and before viser has reported it.
    slider._impl.sync_cb = lambda *_: join(playback.update)
    told = server.gui._handle_gui_updates(0, _messages.GuiUpdateMessage(slider._impl.uuid, {"value": 0.3}))
    asyncio.run_coroutine_threadsafe(told, server.get_event_loop()).result(PATIENCE)
    playback.advance(100.0)
    server._connected_clients.clear()
    assert times(players) == pytest.approx([0.3, 0.3])


def test_they_go_on_together(playback: Playback, players: tuple[Player, Player]) -> None:
    playback.seek(0.6)
    playback.play_or_pause()
    for now in (100.0, 100.1):
        playback.advance(now)
    assert times(players) == pytest.approx([0.39, 0.7])
    playback.play_or_pause()
    assert not playback.playing
    playback.play_or_pause()
    for now in (200.0, 201.0):
        playback.advance(now)
    assert times(players) == pytest.approx([0.39, 0.99])
    playback.play_or_pause()
    assert times(players) == [0.0, 0.0]
    assert all(player.playing for player in players)


def test_after_the_last_touch_all_play_from_the_first(
    playback: Playback, players: tuple[Player, Player]
) -> None:
    playback.seek(0.6)
    playback.play_or_pause()
    playback.advance(100.0)
    playback.next_touch()
    assert all(player.view.contacts for player in players)
    for now in (100.1, 100.15):
        playback.advance(now)
    began = [player.touches[0].began - player.begin + 0.05 for player in players]
    assert times(players) == pytest.approx(began)
