"""Tests of the page in a real browser: a click on the skin, a moved slider, a fault, a recording."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

import tci
from helpers.browser import (
    COARSE,
    PATIENCE,
    canvas_of,
    field,
    files,
    on_screen,
    page_of,
    running,
    skin_on_screen,
    wait_for,
)
from tci.gate.gate import GateState
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.session import Session
from tci.messages.frames import apply
from tci.recording.recording import Recording

pytestmark = pytest.mark.xdist_group("browser")
ROBOTS = ("nao", "icub")
PATCHES = ("left_upper_arm", "right_upper_arm")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def viewer(folder: Path) -> Iterator[Viewer]:
    reflex = tci.WithdrawalReflex()
    drivers = [tci.connect(name, "sim", step=0.002, people=1, self_touch=False) for name in ROBOTS]
    sessions = [
        Session(driver, reflex, about={"middleware": "sim", "capability": "withdrawal"}) for driver in drivers
    ]
    with running(Viewer(sessions, port=0, folder=folder)) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def page(viewer: Viewer) -> Iterator[Page]:
    with page_of(viewer) as page:
        yield page


def poke_everywhere(viewer: Viewer, page: Page, wanted: bool) -> None:
    """Ticks or unticks the box "same place on every robot"."""
    box = page.get_by_label("same place on every robot")
    if box.is_checked() != wanted:
        box.click()
    wait_for(
        lambda: viewer._everywhere is not None and viewer._everywhere.value is wanted, f"the box is {wanted}"
    )


def test_the_page_says_how_the_robots_are(page: Page) -> None:
    for title in ("NAO", "iCub"):
        page.get_by_text(title, exact=True).first.wait_for()
    page.get_by_text("commands pass, within limits").first.wait_for()
    page.get_by_text("force on the skin [N]").first.wait_for()


def test_a_touch_outside_all_fields_is_told(viewer: Viewer, page: Page) -> None:
    page.get_by_text("forearm flexor").first.wait_for()
    wait_for(lambda: all(s.view and s.view.finger is None for s in viewer.sessions.values()), "all is quiet")
    x, y, _ = skin_on_screen(viewer, "nao", "left_upper_arm", canvas_of(page), outside=True)
    page.mouse.click(x, y)
    session, figure = viewer.sessions["nao"], viewer.figures["nao"]
    wait_for(lambda: session.view is not None and session.view.contacts, "the skin feels it")
    session.pace = 0.02  # the finger presses until the page has been inspected
    wait_for(lambda: figure._outside.visible, "it stands beside the finger")
    page.get_by_text("touched outside all fields: left upper arm").first.wait_for()
    session.pace = 1.0
    wait_for(lambda: not figure._outside.visible, "it goes with the finger")


@pytest.mark.parametrize("name", ROBOTS)
def test_a_click_on_the_skin_is_answered_on_the_server_and_in_the_page(
    viewer: Viewer, page: Page, name: str
) -> None:
    session = viewer.sessions[name]
    others = [other.pokes for key, other in viewer.sessions.items() if key != name]
    poke_everywhere(viewer, page, False)
    view = session.view
    assert view is not None
    start, pokes = view.posture["left_arm"], session.pokes
    x, y, _ = skin_on_screen(viewer, name, "left_forearm", canvas_of(page))
    page.mouse.click(x, y)
    wait_for(lambda: session.pokes == pokes + 1, "the click reaches the robot")
    wait_for(lambda: session.history.series("left_arm")[1].max() > 0.1, "the skin feels it")

    def moved() -> bool:
        view = session.view
        return view is not None and bool(np.abs(view.posture["left_arm"] - start).max() > np.deg2rad(3.0))

    wait_for(moved, "the reflex moves the arm")
    page.get_by_text("touched: left forearm").first.wait_for()
    page.get_by_text("left arm goes to").first.wait_for()
    assert [other.pokes for key, other in viewer.sessions.items() if key != name] == others


def test_the_same_place_is_poked_on_every_robot(viewer: Viewer, page: Page) -> None:
    poke_everywhere(viewer, page, True)
    before = [session.pokes for session in viewer.sessions.values()]
    x, y, _ = skin_on_screen(viewer, "nao", "left_forearm", canvas_of(page))
    page.mouse.click(x, y)
    wait_for(
        lambda: [session.pokes for session in viewer.sessions.values()] == [count + 1 for count in before],
        "both robots are poked",
    )


def test_dragging_along_the_skin_strokes_it_and_tells_asked_and_felt(viewer: Viewer, page: Page) -> None:
    session = viewer.sessions["icub"]
    poke_everywhere(viewer, page, False)
    x, y, _ = skin_on_screen(viewer, "icub", "left_upper_arm", canvas_of(page))
    before = session.pokes
    page.mouse.move(x, y)
    page.mouse.down()
    wait_for(lambda: session.view.hands and session.view.hands[0].force > 1.0, "holding still presses")
    asked = session.view.hands[0].asked
    page.mouse.wheel(0.0, -300.0)
    wait_for(lambda: session.view.hands[0].asked > 1.1 * asked, "the wheel makes it firmer")
    page.get_by_text(re.compile(r"iCub: asked \d+\.\d N, presses \d+\.\d N, felt \d+\.\d N")).first.wait_for()
    page.mouse.move(x, y + 12.0, steps=6)
    page.mouse.up()
    wait_for(lambda: not session.view.hands, "the hand goes when the button is up")
    said = " | ".join(words for _, words in session.events)
    assert "press 'left_upper_arm taxel" in said or "stroke 'left_upper_arm taxel" in said
    assert session.history.series("left_arm")[1].max() > 1.0
    assert session.pokes == before


def test_two_fingers_touch_with_two_hands(viewer: Viewer, page: Page) -> None:
    session = viewer.sessions["nao"]
    places = [skin_on_screen(viewer, "nao", patch, canvas_of(page))[:2] for patch in PATCHES]
    tablet = page.context.new_cdp_session(page)
    points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
    tablet.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points})
    wait_for(lambda: len(session.view.hands) == 2, "two hands come")
    wait_for(lambda: all(hand.force > 0.5 for hand in session.view.hands), "both press")
    tablet.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    wait_for(lambda: not session.view.hands, "both go")


def test_a_click_beside_the_robots_pokes_nobody(viewer: Viewer, page: Page) -> None:
    before = [session.pokes for session in viewer.sessions.values()]
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2.0, box["y"] + box["height"] - 30.0)
    page.get_by_text("No skin at that place.").wait_for()
    assert [session.pokes for session in viewer.sessions.values()] == before


def test_a_slider_moves_the_robot_through_the_gate(viewer: Viewer, page: Page) -> None:
    session = viewer.sessions["nao"]
    number = field(page, "shoulder roll [deg]")
    number.fill("40")
    number.press("Enter")

    def there() -> bool:
        view = session.view
        return view is not None and bool(abs(np.rad2deg(view.posture["left_arm"][1]) - 40.0) < 1.0)

    wait_for(there, "the arm goes where the slider says")
    assert session.view is not None
    assert session.view.state is GateState.RUN


def test_a_fault_is_told_with_its_reason_and_reset(viewer: Viewer, page: Page) -> None:
    session = viewer.sessions["nao"]
    page.get_by_text("faults", exact=True).first.click()
    page.get_by_label("fault", exact=True).first.click()
    page.get_by_role("option", name="encoder-step").click()
    page.get_by_text("the first encoder jumps by 10 degrees").first.wait_for()
    page.get_by_role("button", name="Inject").first.click()
    wait_for(lambda: session.view is not None and session.view.state is GateState.STOP, "the gate stops")
    assert session.view is not None
    assert session.view.reason
    page.get_by_text(session.view.reason).first.wait_for()
    page.get_by_text("STOP", exact=True).first.wait_for()
    page.get_by_text(re.compile(r"encoder-step for 1 s.*: after \d+ ms STOP: ")).first.wait_for()
    other = viewer.sessions["icub"].view
    assert other is not None
    assert other.state is GateState.RUN
    wait_for(lambda: not session.driver.active, "the fault ends")
    page.get_by_text("Reset", exact=True).first.click()
    wait_for(lambda: session.view is not None and session.view.state is GateState.RUN, "it runs again")


def test_a_recording_is_made_and_its_name_stays_in_the_folder(
    viewer: Viewer, page: Page, folder: Path
) -> None:
    page.get_by_text("recording", exact=True).first.click()
    name = field(page, "file")
    button = page.get_by_role("button", name="Record").first
    name.fill("../outside.mcap")
    name.press("Enter")
    wait_for(lambda: viewer.controls["nao"].file.value == "../outside.mcap", "the name reaches the server")
    button.click()
    page.get_by_text("no file may be named").wait_for()
    assert not (folder.parent / "outside.mcap").exists()
    name.fill("touch.mcap")
    name.press("Enter")
    wait_for(lambda: viewer.controls["nao"].file.value == "touch.mcap", "the name reaches the server")
    button.click()
    wait_for(lambda: viewer.sessions["nao"].recorder is not None, "it records")
    wait_for(lambda: viewer.sessions["nao"].recorder.ticks > 20, "periods are written")
    page.get_by_role("button", name="Stop recording").first.click()
    page.get_by_text("periods,").filter(has_text="MB").first.wait_for()
    assert files(folder) == ["touch.mcap"]
    recording = Recording(folder / "touch.mcap")
    assert recording.topics()["/tci/tick"].messages > 20
    assert recording.complete
    assert recording.about["capability"] == "withdrawal"


def test_a_narrow_window_shows_the_arms_of_all(viewer: Viewer, page: Page) -> None:
    page.set_viewport_size({"width": 850, "height": 700})
    wait_for(lambda: canvas_of(page)[2] > 400, "the plots make room")
    page.set_viewport_size({"width": 390, "height": 700})

    def shown() -> bool:
        canvas = canvas_of(page)
        for figure in viewer.figures.values():
            for patch in ("left_forearm", "right_forearm"):
                surface = figure.skin.surfaces[patch]
                points = apply(figure.pose(surface.link), surface.positions)
                across = on_screen(viewer, points, canvas)[:, 0]
                if not (canvas[0] < across.min() and across.max() < canvas[0] + canvas[2]):
                    return False
        return canvas[2] == 390

    wait_for(shown, "both arms of both robots are in the picture")


LOSES_ONE = (
    "addEventListener('click', event => event.stopImmediatePropagation(), {capture: true, once: true})"
)
"""JavaScript that drops the first click, as a browser does that draws the page again at this moment."""


def test_on_a_telephone_the_controls_begin_folded(viewer: Viewer, page: Page) -> None:
    assert page.context.browser is not None
    with page.context.browser.new_page(
        viewport={"width": 390, "height": 844}, device_scale_factor=COARSE
    ) as phone:
        phone.set_default_timeout(PATIENCE * 1000.0)
        phone.add_init_script(LOSES_ONE)
        phone.goto(viewer.address)
        title = phone.get_by_text("TCI", exact=True).first
        title.wait_for()

        def folded() -> bool:
            box = title.bounding_box()
            return box is not None and box["y"] > 700

        wait_for(folded, "they are folded")
