"""Playback of a recording in a real browser: play, pause, move the slider."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

import tci
from helpers.browser import field, page_of, running, wait_for
from helpers.recorded import record_poke
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.guard import close_server
from tci.lab.viewer.player import Player
from tci.recording.recording import Recording

pytestmark = pytest.mark.xdist_group("browser")


@pytest.fixture(scope="module")
def player(tmp_path_factory: pytest.TempPathFactory) -> Player:
    path: Path = tmp_path_factory.mktemp("playback") / "poke.mcap"
    record_poke(path, duration=1.0)
    return Player(Recording(path), tci.load_robot("nao"))


@pytest.fixture(scope="module")
def viewer(player: Player) -> Iterator[Viewer]:
    with running(Viewer([player], port=0)) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def page(viewer: Viewer) -> Iterator[Page]:
    with page_of(viewer) as page:
        yield page


def test_play_pause_and_scrub(player: Player, page: Page) -> None:
    # One second of recording would end before the page is open.
    wait_for(lambda: player.time == player.end, "it plays to the end")
    page.get_by_text("touched: left forearm").first.wait_for()
    page.get_by_role("button", name="Play").wait_for()

    time = field(page, "time [s]")
    # If the viewer still moves the slider, typed text is appended to its number.
    wait_for(lambda: time.input_value() == f"{player.end - player.begin:.2f}", "the slider is at the end")
    time.fill("0.1")
    time.press("Enter")
    wait_for(lambda: abs(player.time - player.begin - 0.1) < 0.011, "the slider sets the time")
    page.get_by_text("no events yet").wait_for()
    page.get_by_text("paused at 0.10").wait_for()

    touch = player.touches[0]
    time.fill(f"{touch.began - player.begin + 0.02:.2f}")
    time.press("Enter")
    wait_for(lambda: player.view.contacts, "the touch is shown")
    page.get_by_text("left forearm, flexor side").first.wait_for()
    page.get_by_text("commands pass, within limits").wait_for()

    time.fill("0")
    time.press("Enter")
    wait_for(lambda: player.time == player.begin, "it is at the begin")
    page.get_by_role("button", name="Next touch").click()
    wait_for(lambda: player.time == touch.began, "it is at the touch")
    page.get_by_text("left forearm, flexor side").first.wait_for()

    field(page, "speed").click()
    page.get_by_role("option", name="0.1", exact=True).click()
    wait_for(lambda: player.speed == 0.1, "the speed is set")
    before = player.time
    page.get_by_role("button", name="Play").click()
    wait_for(lambda: player.playing and player.time > before, "it plays on")
    page.get_by_role("button", name="Pause").click()
    wait_for(lambda: not player.playing, "it is paused")
    assert before < player.time <= player.end


def test_the_page_says_when_its_server_has_ended(viewer: Viewer, page: Page) -> None:
    told = page.get_by_role("alert").filter(has_text="The viewer has ended")
    assert not told.is_visible()
    close_server(viewer.server)
    told.wait_for()
