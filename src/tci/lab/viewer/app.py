"""The viewer application: puts robots, controls and plots on one page, and updates the page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import viser

from tci.body.places import Place, find_place
from tci.errors import TciError
from tci.lab.viewer.controls import Controls
from tci.lab.viewer.fields import legend
from tci.lab.viewer.figure import Figure
from tci.lab.viewer.fingers import Fingers
from tci.lab.viewer.framing import Framing
from tci.lab.viewer.guard import close_server, open_server
from tci.lab.viewer.labels import badge, event_list
from tci.lab.viewer.pick import pick
from tci.lab.viewer.playback import Playback
from tci.lab.viewer.player import Player
from tci.lab.viewer.plots import Plots
from tci.lab.viewer.session import Session
from tci.messages.frames import Array, apply, invert
from tci.robot.generic_arm import limb_coordinates
from tci.robot.joint_map import generic_posture

RATE = 30.0
"""Picture rate [Hz]."""
SLOW = 6
"""Number of pictures between two updates of plots, sliders and texts."""
WIDTH = 390
"""Width [pixels] of the panel with the controls. At this width each event fits into one line."""
SPACE = 0.25
"""Free space [m] between two robots."""
SKY = (208, 218, 230), (250, 250, 250)
"""Colours of the background, from top to bottom. These colours are darker than white, so that a white robot
is visible."""
Source = Session | Player
"""Source of the data that the page shows of one robot: the running robot, or a recording of it."""
HINT = (
    "**Click the skin** to poke it there, **drag along it** to stroke it, **hold** to press: longer is "
    "firmer, and so is the wheel. Two fingers are two touches. Drag beside it to rotate, scroll to zoom."
)


class Viewer:
    """A page with all robots side by side. `run` updates the page until another thread calls `stop`."""

    def __init__(
        self,
        sources: Sequence[Source],
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        folder: Path = Path("recordings"),
        told: Callable[[], str] | None = None,
        again: Callable[[], None] = lambda: None,
    ) -> None:
        """Opens the page. Raises DriverError if the port is in use.

        Args:
            sources: robots and recordings, the first one at the left.
            host: address on which the page is served.
            port: 0 chooses a free one.
            folder: where new recordings are written.
            told: what a show says now, in Markdown; None without a show.
            again: starts the show again.
        """
        self.sources: Mapping[str, Source] = _by_key(sources)
        self.sessions = {key: source for key, source in self.sources.items() if isinstance(source, Session)}
        """Sources with a running robot, by the robot's name. If several robots have one name, a number after
        the name distinguishes them. Recordings are not included."""
        names = " and ".join(dict.fromkeys(_title(source) for source in sources))
        self.fingers = Fingers(
            lambda: self.server.get_clients(), self._picked, lambda: float(self._force.value), self.poke,
            self._touch, lambda key, finger: self.sources[key].let_go(finger),
        )  # fmt: skip
        touchable = any(source.world is not None for source in sources)
        self.server, self.guard, self.address = open_server(
            host, port, label="TCI", title=f"{names} - TCI",
            touched=self.fingers.handle if touchable else None,
        )  # fmt: skip
        self._was_opened = False
        self.pictures = 0
        """Number of pictures shown."""
        self._stop = threading.Event()
        self._clicks: list[tuple[Array, Array]] = []
        self._touched = False
        self._refused: tuple[str, object] | None = None
        self.figures = {key: Figure(self.server, source.robot, key) for key, source in self.sources.items()}
        for key, source in self.sources.items():
            self.figures[key].show_fields(source.fields)
        self._stand_side_by_side()
        self._set_scene()
        self._told = told
        if told is not None:
            self._add_show(again)
        self._add_panels(folder)

    def run(self, *, duration: float | None = None, until: Callable[[], bool] = lambda: False) -> None:
        """Updates the page until `stop` is called, `duration` [s] is over, or `until` returns True."""
        begin = due = time.monotonic()
        while not (self._stop.is_set() or until()) and (
            duration is None or time.monotonic() - begin < duration
        ):
            self.update(words=self.pictures % SLOW == 0)
            due = max(due + 1.0 / RATE, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def stop(self) -> None:
        """Lets `run` return. Any thread may call this method."""
        self._stop.set()

    def close(self) -> None:
        """Brings the robots to rest and closes the page."""
        for source in self.sources.values():
            source.close()
        close_server(self.server)

    def update(self, *, words: bool) -> None:
        """Draws one picture of the robots. If `words` is true, also updates plots, sliders and texts."""
        self.pictures += 1
        now = time.monotonic()
        watched = bool(self.server.get_clients())
        self._was_opened |= watched
        if self.playback is not None and self._was_opened:  # else the beginning would be missed
            self.playback.advance(now)
        if not watched:
            return  # a page that opens later shows the last drawing, and then the next picture
        self._framing.update()
        for key, source in self.sources.items():
            if source.view is not None:
                self.figures[key].show(source.view)
        while self._clicks:
            self._clicked(*self._clicks.pop(0))
        self.fingers.update()
        if words:
            self._show_events()
            self._plots.update({key: source.history for key, source in self.sources.items()})
            for controls in self.controls.values():
                controls.update()
            if self.playback is not None:
                self.playback.update()

    def poke(self, key: str, place: Place) -> None:
        """Pokes a robot's skin with the force and speed of the sliders. If "same place on every robot" is
        selected on the page, also pokes the corresponding points of the other robots."""
        touched = self.sources[key]
        self._poke(touched, place)
        if self._everywhere is None or not self._everywhere.value or touched.view is None:
            return
        figure, joints = self.figures[key], touched.view.joints
        patch = figure.robot.patch(place.patch)
        segment = figure.robot.limb_segment(patch)
        if segment is None:
            return
        part = figure.robot.part(patch.part)
        T_TS = figure.skin.segment_pose(
            part.name, patch.segment, joints, generic_posture(figure.robot, joints)[part.name]
        )
        T_SL = invert(T_TS) @ figure.skin.link_pose(patch.link, joints)
        assert part.side is not None  # Skin
        u, theta = limb_coordinates(apply(T_SL, place.p_L), part.segment(patch.segment).length, part.side)
        for other, source in self.sources.items():
            if other == key or source.view is None:
                continue
            try:
                there = find_place(
                    self.figures[other].skin, part.name, patch.segment,
                    float(u), float(theta), source.view.joints,
                )  # fmt: skip
                self._poke(source, there)
            except TciError as error:
                source.say(str(error))

    def _poke(self, source: Source, place: Place) -> None:
        try:
            source.poke(place, force=float(self._force.value), speed=float(self._speed.value))
        except TciError as error:
            source.say(str(error))

    def _touch(self, key: str, finger: object, place: Place, force: float) -> None:
        try:
            self.sources[key].touch(finger, place, force=force)
        except TciError as error:
            if self._refused != (key, finger):  # once for each finger, not in every picture
                self.sources[key].say(str(error))
            self._refused = key, finger

    def _clicked(self, origin: Array, direction: Array) -> None:
        hit = self._picked(origin, direction)
        _set(self._hint, HINT if hit is not None else "No skin at that place. " + HINT)
        if hit is not None:
            self.poke(*hit)

    def _picked(self, origin: Array, direction: Array) -> tuple[str, Place] | None:
        """Robot and place that a ray meets first."""
        found = [(hit[1], key, hit[0]) for key, figure in self.figures.items()
                 if (hit := pick(figure, origin, direction)) is not None]  # fmt: skip
        return min(found, key=lambda hit: hit[0])[1:] if found else None

    def _stand_side_by_side(self) -> None:
        """Places the robots in a row. The first robot is at the left of the picture."""
        total = sum(figure.width for figure in self.figures.values()) + SPACE * (len(self.figures) - 1)
        left = -total / 2.0
        for figure in self.figures.values():
            figure.stand(left + figure.width / 2.0)
            left += figure.width + SPACE
        self._width = total

    def _set_scene(self) -> None:
        scene = self.server.scene
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(hdri=None)
        scene.set_background_image(np.linspace(*SKY, 64).astype(np.uint8)[:, None], format="png")
        scene.add_light_ambient("/light/ambient", intensity=1.7)
        scene.add_light_directional("/light/sun", intensity=1.6, position=(3.0, 1.5, 4.0))
        scene.add_light_directional("/light/sky", intensity=0.5, position=(1.0, -4.0, 2.0))
        scene.add_grid(
            "/floor", width=12.0, height=12.0, cell_size=0.1, section_size=0.5,
            cell_color=(228, 230, 233), section_color=(205, 209, 214), shadow_opacity=0.0,
        )  # fmt: skip

    def _add_panels(self, folder: Path) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(28, 126, 214))
        self._badges = {key: gui.add_html("") for key in self.sources}
        self._everywhere: viser.GuiCheckboxHandle | None = None
        if any(source.world is not None for source in self.sources.values()):
            self._add_poke()
        self.playback: Playback | None = None
        players = [source for source in self.sources.values() if isinstance(source, Player)]
        if players:
            with gui.add_folder("recording"):
                self.playback = Playback(self.server, players)
        fields = dict.fromkeys(field for source in self.sources.values() for field in source.fields)
        if fields:
            with gui.add_folder("receptive fields"):
                gui.add_html(legend(tuple(fields)))
        with gui.add_folder("events"):
            self._events = gui.add_html("")
        self.controls: dict[str, Controls] = {}
        if self.sessions:
            tabs = gui.add_tab_group()
            for key, session in self.sessions.items():
                with tabs.add_tab(_title(session)):
                    self.controls[key] = Controls(self.server, session, key, folder)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        panel = gui.add_panel()
        titles = {key: _title(source) for key, source in self.sources.items()}
        arms = dict.fromkeys(
            part.name for source in self.sources.values() for part in source.robot.parts
            if part.kind == "arm"
        )  # fmt: skip
        with panel.add_tab("last seconds"):
            self._plots = Plots(self.server, titles, tuple(arms))
        panel.dock_left()
        panel.set_width(300)
        tallest = max(figure.height for figure in self.figures.values())
        self._framing = Framing(self.server, panel, width=self._width, height=tallest)

    def _add_show(self, again: Callable[[], None]) -> None:
        with self.server.gui.add_folder("the show"):
            self._story = self.server.gui.add_markdown("")
            button = self.server.gui.add_button("Show it again")
        button.on_click(lambda _: again())

    def _add_poke(self) -> None:
        gui = self.server.gui
        assumed = {
            source.robot.name: None
            for source in self.sources.values()
            if any(patch.assumed for patch in source.robot.patches)
        }
        told = f" Skin of {', '.join(assumed)} is partly assumed: nobody has seen it there." * bool(assumed)
        self._hint = gui.add_markdown(HINT + told)
        others = [_title(one) for one in self.sources.values() if one.world is None]
        if others:
            gui.add_markdown(f"{', '.join(others)}: not simulated, so it can't be touched from here.")

        @self.server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            # The page's own script reads there which client its fingers belong to.
            client.gui.add_html(f'<i hidden data-tci-client="{client.client_id}"></i>')

        with gui.add_folder("poke and touch"):
            self._force = gui.add_slider("force [N]", 0.5, 10.0, 0.5, 5.0)
            self._speed = gui.add_slider("speed [m/s]", 0.05, 0.5, 0.05, 0.25)
            if len(self.sources) > 1:
                self._everywhere = gui.add_checkbox("same place on every robot", True)
            self._touches = gui.add_html("")
            pace = gui.add_slider("pace (1 is real time)", 0.0, 1.0, 0.05, 1.0)
            pace.on_update(lambda _: self._set_pace(float(pace.value)))

        @self.server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            # Figures may be used by the drawing thread only.
            self._clicks.append((np.array(event.ray_origin), np.array(event.ray_direction)))

    def _set_pace(self, pace: float) -> None:
        for session in self.sessions.values():
            session.pace = pace

    def _show_events(self) -> None:
        if self._told is not None:
            _set(self._story, self._told())
        events: list[tuple[str, float, str]] = []
        hands: list[str] = []
        for key, source in self.sources.items():
            _set(self._badges[key], _badge(source))
            self.figures[key].show_fields(source.fields)
            if source.view is not None:
                hands += [f"{_title(source)}: {hand.words}" for hand in source.view.hands]
            events += [(_title(source), stamp, words) for stamp, words in list(source.events)[-6:]]
        if hands or self._touched:
            _set(self._touches, "<br>".join(hands))
        self._touched = bool(hands)
        _set(self._events, event_list(sorted(events, key=lambda event: -event[1])[:8]))


def _badge(source: Source) -> str:
    return badge(_title(source), source.view, source.ended, source.loop_words, source.robot.switches)


def _set(handle: viser.GuiHtmlHandle | viser.GuiMarkdownHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content


def _by_key(sources: Sequence[Source]) -> dict[str, Source]:
    found: dict[str, Source] = {}
    for source in sources:
        name, number = source.robot.name, 2
        key = name
        while key in found:
            key, number = f"{name}-{number}", number + 1
        found[key] = source
    return found


def _title(source: Source) -> str:
    return (source.robot.title or source.robot.name).split()[0]
