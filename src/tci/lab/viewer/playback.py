"""Controls for the recordings on the page: play, pause, seek, speed. All recordings are synchronised."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any

import viser

from tci.lab.viewer.player import Player

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5")
MINE = 0.5
"""Time [s] after a person has moved the slider, during which the playback does not move the slider. Assumed:
a person who drags the slider never pauses for longer."""
STEP = 0.01
"""Finest step [s] of the slider."""


class Playback:
    """Controls, such as play and pause, for all recordings on the page. The controls are added to the
    container that is open in viser. The method `advance` executes a person's requests."""

    def __init__(self, server: viser.ViserServer, players: Sequence[Player]) -> None:
        self._server = server
        self._players = tuple(players)
        self._asked: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._touched = -MINE
        gui = server.gui
        longest = max(player.end - player.begin for player in players)
        self._began = sorted(touch.began - player.begin for player in players for touch in player.touches)
        self._button = gui.add_button("Pause")
        self.slider = gui.add_slider("time [s]", 0.0, max(round(longest, 2), STEP), STEP, 0.0)
        speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        jump = gui.add_button("Next touch", disabled=not self._began)
        self._button.on_click(lambda _: self._asked.put(self.play_or_pause))
        jump.on_click(lambda _: self._asked.put(self.next_touch))
        speed.on_update(lambda _: self._asked.put(partial(self.set_speed, float(speed.value))))

        # viser runs an `async` function at once, in viser's own thread.
        @self.slider.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return  # The viewer has moved the slider, and not a person.
            self._touched = time.monotonic()
            self._asked.put(partial(self.seek, float(self.slider.value)))

    @property
    def time(self) -> float:
        """Present time [s] from the beginning of the recordings. A shorter recording stays at its end."""
        return max(player.time - player.begin for player in self._players)

    @property
    def playing(self) -> bool:
        """True if any recording plays."""
        return any(player.playing for player in self._players)

    def advance(self, now: float) -> None:
        """Executes a person's requests, then advances the recordings to `now` [s] on the machine's clock."""
        while not self._asked.empty():
            self._asked.get()()
        for player in self._players:
            player.advance(now)

    def play_or_pause(self) -> None:
        """Pauses or continues. If all recordings are at their end, starts from the beginning."""
        if self.playing:
            for player in self._players:
                player.pause()
        else:
            over = all(player.time >= player.end for player in self._players)
            self._play(self._players if over else self._unfinished())

    def seek(self, moment: float) -> None:
        """Jumps to the time `moment` [s] from the beginning of every recording, and pauses there."""
        for player in self._players:
            player.pause()
            player.seek(player.begin + moment)

    def next_touch(self) -> None:
        """Sets the playback to the time of the next touch. After the last touch, sets the playback to the
        time of the first touch."""
        following = [moment for moment in self._began if moment > self.time + 1e-9]
        playing = self.playing
        self.seek((following or self._began)[0])
        if playing:
            self._play(self._unfinished())

    def set_speed(self, speed: float) -> None:
        """Sets the speed [recorded seconds per second]."""
        for player in self._players:
            player.speed = speed

    def update(self) -> None:
        """Updates the slider in viser's thread, after the inputs of a person that have already arrived."""
        self._server.get_event_loop().call_soon_threadsafe(self._follow)

    def _follow(self) -> None:
        """Moves the slider to the present time of the recording, unless a person has just moved the slider.
        Also updates the button's label (Play or Pause)."""
        value = min(round(self.time, 2), self.slider.max)
        if time.monotonic() - self._touched > MINE and abs(value - self.slider.value) > STEP / 2.0:
            self.slider.value = value  # type: ignore[misc] # viser's types say read-only
        label = "Pause" if self.playing else "Play"
        if self._button.label != label:
            self._button.label = label

    def _unfinished(self) -> list[Player]:
        return [player for player in self._players if player.time < player.end]

    def _play(self, players: Sequence[Player]) -> None:
        for player in players:
            player.play()
