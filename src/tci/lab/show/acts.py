"""What people do in the show, act by act, in the words of `tci run --touch`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tci.robot.description import Robot

CAST = ("nao", "icub", "g1-inspire")
"""Robots of the show: three makers, three skins. The first one is taught."""
POKED, PATTED = "poked", "patted"
PLACES = {POKED: "'left forearm'", PATTED: "'right forearm'"}
HANDS = {
    POKED: {"g1-inspire": "left_index_top"},
    PATTED: {"g1-inspire": "'palm of right hand'"},
}
"""Places on robots that have no skin on their forearms."""


@dataclass(frozen=True, slots=True)
class Act:
    """One act of the show."""

    name: str
    words: str
    """What people do, and what they see."""
    touches: tuple[str, ...]
    """`{poked}` and `{patted}` are places of the robot."""
    lasts: float
    """[s]"""
    teaches: bool = False
    """On the first robot only: what it is taught, all repeat later."""
    repeats: bool = False
    """All robots know what the first one was taught."""

    def on(self, robot: Robot) -> tuple[str, ...]:
        """The touches on one robot."""
        names: Mapping[str, str] = {
            part: HANDS[part].get(robot.name, words) for part, words in PLACES.items()
        }
        return tuple(words.format(**names) for words in self.touches)


ACTS = (
    Act("poke", "a hard poke: it flinches", ("poke {poked} 20N @1.6s",), 4.5),
    Act("pat", "a pat: it looks", ("pat {patted} 2N @1s",), 5.0),
    Act(
        "guide",
        "two fingers lift an arm, a tap on the other arm: it repeats",
        (
            "push 'left forearm back' 0.3 3N 1s @0.6s",
            "push 'left forearm back' 0.8 3N 1s @0.6s",
            "tap {patted} @2.6s",
        ),
        7.5,
        teaches=True,
    ),
    Act(
        "repeat",
        "the same file on every robot: a tap, and all repeat",
        ("tap {patted} @0.6s",),
        6.0,
        repeats=True,
    ),
)
