"""Play, pause, scrub and speed of the recordings on the page. They share one time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import viser

from tci.viewer.player import Player

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5")
MINE = 0.5
"""How long [s] the slider stays where a person put it before it follows again. Ours."""
BEFORE = 0.2
"""How long [s] before a touch `Next touch` goes. Ours."""
STEP = 0.01
"""Finest step of the slider [s]."""


class Playback:
    """The controls of all players, inside the container that is open."""

    def __init__(self, server: viser.ViserServer, players: Sequence[Player]) -> None:
        self._players = tuple(players)
        self._touched = -MINE
        gui = server.gui
        longest = max(player.end - player.begin for player in players)
        self._button = gui.add_button("Pause")
        self.slider = gui.add_slider("time [s]", 0.0, max(round(longest, 2), STEP), STEP, 0.0)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        began = sorted(touch.began - player.begin for player in players for touch in player.touches)
        jump = gui.add_button("Next touch", disabled=not began)

        @self._button.on_click
        def _(_: object) -> None:
            playing = any(player.playing for player in self._players)
            for player in self._players:
                player.pause() if playing else player.play()

        # `async`: at once. In a thread of its own the viewer might move the slider back before it is heard.
        @self.slider.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return  # the viewer itself has moved it
            self._touched = time.monotonic()
            for player in self._players:
                player.pause()
                player.seek(player.begin + float(self.slider.value))

        @jump.on_click
        def _(_: object) -> None:
            now = players[0].time - players[0].begin
            following = [moment for moment in began if moment - BEFORE > now + STEP]
            moment = (following or began)[0] - BEFORE
            for player in self._players:
                player.seek(player.begin + moment)

        @self._speed.on_update
        def _(_: object) -> None:
            for player in self._players:
                player.speed = float(self._speed.value)

    def update(self) -> None:
        """Let the slider follow."""
        playing = any(player.playing for player in self._players)
        label = "Pause" if playing else "Play"
        if self._button.label != label:
            self._button.label = label
        first = self._players[0]
        value = min(round(first.time - first.begin, 2), self.slider.max)
        if time.monotonic() - self._touched > MINE and abs(value - self.slider.value) > STEP / 2.0:
            self.slider.value = value  # type: ignore[misc] # viser's types say read-only
