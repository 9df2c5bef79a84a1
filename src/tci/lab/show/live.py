"""The show on the viewer's page: in real time, with everybody's own touches in between."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from tci.capabilities.companion import Companion
from tci.errors import TciError
from tci.gestures.gesture import Gesture
from tci.lab.show.acts import ACTS, Act
from tci.lab.show.touch_show import taught
from tci.lab.viewer.session import Session

WAIT = 0.05
"""Time [s] between two looks at the robots' clocks."""
NAME = "companion"
END = "**Now you**: click, hold or stroke the skin. The file that was taught: `{file}`"


class LiveShow:
    """Directs the robots of the page, in a thread of its own."""

    def __init__(self, sessions: Sequence[Session], file: Path, *, acts: Sequence[Act] = ACTS) -> None:
        """`file` is where what the first robot is taught is written."""
        self._sessions, self._file, self._acts = tuple(sessions), file, tuple(acts)
        self._lesson: Gesture | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._play, name="the show", daemon=True)
        self.words = "The people come in a moment."
        """What happens now, in Markdown."""

    def start(self) -> None:
        """Plays it, from the first act on, unless it plays already."""
        if not self._thread.is_alive():
            self._thread = threading.Thread(target=self._play, name="the show", daemon=True)
            self._thread.start()

    def close(self) -> None:
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    def _play(self) -> None:
        try:
            for number, act in enumerate(self._acts, start=1):
                self.words = f"**{number} of {len(self._acts)}**: {act.words}"
                if not self._act(act):
                    return
            self.words = END.format(file=self._file)
        except TciError as error:
            self.words = f"**The show ended**: {error}"

    def _act(self, act: Act) -> bool:
        """False if the page was closed meanwhile."""
        cast = self._sessions[:1] if act.teaches else self._sessions
        for session in cast:
            session.run(NAME, Companion(gesture=self._lesson if act.repeats else None), home=True)
            session.people_do(act.on(session.robot))
        ends = [(one.view.time if one.view is not None else 0.0) + act.lasts for one in cast]
        while any(one.view is None or one.view.time < end for one, end in zip(cast, ends, strict=True)):
            if self._over.wait(WAIT):
                return False
        if act.teaches:
            self._lesson = taught(cast[0].memory, cast[0].robot, self._file)
        return True
