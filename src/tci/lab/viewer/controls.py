"""Controls of one robot on the page: posture, faults, reset, recording."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import viser

from tci.errors import TciError
from tci.exports.facts import generic_limits
from tci.lab.faults.injectors import INJECTORS
from tci.lab.viewer.rehearsal import description
from tci.lab.viewer.session import Session
from tci.recording.names import inside
from tci.robot.generic_arm import JOINTS
from tci.runtime.arguments import capabilities_for, load_capability

LEFT_OUT = ("sigterm",)
"""Faults that are not offered on the page, because these faults would end the viewer."""
MINE = 1.0
"""Time [s] after a person's movement of a slider, in which the robot's posture does not change the slider.
Assumed: a person who drags a slider never pauses for longer."""
STEP = 0.5
"""Finest step [deg] of a slider."""
FULL_TURN = 180.0


class Controls:
    """Controls of one session. The controls are added to the container that is open in viser."""

    def __init__(self, server: viser.ViserServer, session: Session, key: str, folder: Path) -> None:
        """Adds the controls to the page. New recordings are written to `folder`."""
        self._server = server
        self._gui = server.gui
        self._session = session
        self._key = key
        self._folder = folder
        self._sliders: dict[str, list[tuple[int, viser.GuiSliderHandle[float]]]] = {}
        self._touched: dict[str, float] = {}
        self._add_capability()
        self._add_posture()
        self._add_faults()
        self._add_recording()

    def update(self) -> None:
        """Shows the gate's response to a fault, and updates the sliders. The sliders are updated in viser's
        thread, so that a person's input is handled before they move."""
        self._server.get_event_loop().call_soon_threadsafe(self._name_capability)
        rehearsal = self._session.rehearsal
        if rehearsal is not None and self._answer.content != rehearsal.words:
            self._answer.content = rehearsal.words
        self._server.get_event_loop().call_soon_threadsafe(self._follow)

    def _follow(self) -> None:
        """Moves the sliders to the robot's posture. Sliders that a person has just moved are not changed."""
        view = self._session.view
        if view is None:
            return
        now = time.monotonic()
        for part, sliders in self._sliders.items():
            if now - self._touched.get(part, -np.inf) < MINE or part not in view.posture:
                continue
            degrees = np.rad2deg(view.posture[part])
            for joint, slider in sliders:
                value = _on_slider(degrees[joint], slider.min, slider.max)
                if abs(value - slider.value) > 1e-6:
                    slider.value = value  # type: ignore[misc] # viser's types say read-only

    def _name_capability(self) -> None:
        """The menu says what runs, also if a show has changed it."""
        runs = self._session.runs
        if self.menu.value != runs:
            if runs not in self.menu.options:
                self.menu.options = (runs, *self.menu.options)
            self.menu.value = runs  # type: ignore[misc] # viser's types say read-only

    def _add_capability(self) -> None:
        session = self._session
        names = dict.fromkeys([session.runs, *capabilities_for(session.robot)])
        self.menu = self._gui.add_dropdown("capability", tuple(names), disabled=not session.armed)

        # viser runs an `async` function at once, in viser's own thread.
        @self.menu.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None or self.menu.value == session.runs:
                return  # The viewer has named what runs.
            try:
                session.run(self.menu.value, load_capability(self.menu.value))
            except TciError as error:
                session.say(str(error))

    def _add_posture(self) -> None:
        robot = self._session.robot
        for part in robot.parts:
            if part.kind != "arm":
                continue
            sliders: list[tuple[int, viser.GuiSliderHandle[float]]] = []
            with self._gui.add_folder(part.name.replace("_", " "), expand_by_default=part.side == "left"):
                for joint, limit in enumerate(generic_limits(robot, part.name)):
                    if part.servos[joint].servo is None:
                        continue
                    low = -FULL_TURN if limit.lower is None else float(np.rad2deg(limit.lower))
                    high = FULL_TURN if limit.upper is None else float(np.rad2deg(limit.upper))
                    start = _on_slider(np.rad2deg(part.initial_posture[joint]), low, high)
                    name = JOINTS[joint] if joint < len(JOINTS) else limit.joint
                    slider = self._gui.add_slider(
                        f"{name.replace('_', ' ')} [deg]", low, high, STEP, start,
                        disabled=not self._session.armed,
                    )  # fmt: skip
                    slider.on_update(partial(self._moved, part.name))
                    sliders.append((joint, slider))
            self._sliders[part.name] = sliders
        options = ("Home", "Reset", "Free") if self._session.armed else ("Reset",)
        buttons = self.buttons = self._gui.add_button_group("arms", options)

        @buttons.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            {"Home": self._session.home, "Reset": self._session.reset, "Free": self._session.free}[
                event.target.value
            ]()

    # viser runs an `async` function at once, in viser's own thread.
    async def _moved(self, part: str, event: viser.GuiEvent[Any]) -> None:
        view = self._session.view
        if event.client is None or view is None:
            return  # The viewer has moved the slider, and not a person.
        self._touched[part] = time.monotonic()
        posture = np.array(view.posture[part])
        for joint, slider in self._sliders[part]:
            posture[joint] = np.deg2rad(slider.value)
        self._session.move(part, posture)

    def _add_faults(self) -> None:
        names = [name for name in INJECTORS if name not in LEFT_OUT]
        with self._gui.add_folder("faults", expand_by_default=False):
            menu = self._gui.add_dropdown("fault", names)
            lasts = self._gui.add_number("for [s]", 1.0, min=0.1, max=600.0, step=0.1)
            says = self._gui.add_markdown(description(names[0]))
            button = self._gui.add_button("Inject", disabled=not self._session.armed)
            self._answer = self._gui.add_markdown("")

        @menu.on_update
        def _(_: object) -> None:
            says.content = description(menu.value)

        @button.on_click
        def _(_: object) -> None:
            self._session.inject(menu.value, lasts=float(lasts.value))

    def _add_recording(self) -> None:
        with self._gui.add_folder("recording", expand_by_default=False):
            name = self.file = self._gui.add_text("file", self._free_name())
            button = self._gui.add_button("Record", color="red")
            label = self._gui.add_markdown(f"writes to `{self._folder}`")

        @button.on_click
        def _(_: object) -> None:
            try:
                if self._session.recorder is None:
                    path = inside(self._folder, name.value)
                    self._folder.mkdir(parents=True, exist_ok=True)
                    self._session.record(path)
                    button.label, label.content = "Stop recording", f"recording to `{path}`"
                else:
                    button.disabled, label.content = True, "compressing ..."
                    recorder = self._session.stop_recording()
                    button.disabled, button.label = False, "Record"
                    if recorder is not None:
                        size = recorder.path.stat().st_size / 1e6
                        words = recorder.failed or f"{recorder.ticks} periods, {size:.2f} MB"
                        label.content = f"`{recorder.path}`: {words}"
                    name.value = self._free_name()  # type: ignore[misc] # viser's types say read-only
            except (TciError, OSError) as error:
                label.content = f"**{error}**"

    def _free_name(self) -> str:
        number = 1
        while (self._folder / f"{self._key}-{number}.mcap").exists():
            number += 1
        return f"{self._key}-{number}.mcap"


def _on_slider(degrees: float, low: float, high: float) -> float:
    """Returns the value [deg] nearest to `degrees` that a slider with the range `low` to `high` can have."""
    return float(np.clip(round(degrees / STEP) * STEP, low, high))
