"""Touch words: tells what kind of touch somebody made, where, how firmly, and how sure that is.

It moves nothing. A word is told half a second after the end of a touch at the latest; a touch that means
nothing, such as a sleeve or somebody who leans on the robot, is told as `other`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from tci.body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.capabilities.touch_words.features import features
from tci.capabilities.touch_words.head import HeadTouch, feel_head, head_switches
from tci.capabilities.touch_words.recogniser import OTHER, Recogniser, read_recogniser
from tci.capabilities.touch_words.tactile_gestures import GESTURES
from tci.capabilities.touch_words.tracks import Track, Tracks, follow
from tci.capabilities.touch_words.vocabulary import FEW_WORDS, HELD, SWITCH_WORDS, is_few, merged
from tci.errors import TciError
from tci.messages import Contact, Order, Perception
from tci.messages.frames import Array

OWN = Path(__file__).with_name("words.npz")
KEPT = 100
"""Number of words that are remembered. Assumed: nobody looks farther back."""


@dataclass(frozen=True, slots=True)
class TouchWord:
    """One touch, and what it was."""

    word: str
    """A kind of touch, the name of a gesture on a NAO's head, or `other`."""
    certainty: float
    """Probability 0..1 of the word, as the recogniser sees it."""
    strongest: Contact
    """The contact in which it was firmest: where on which part."""
    onset: float
    """[s]"""
    end: float
    """When it was last felt [s]."""
    told: float
    """When the word was told [s]."""

    @property
    def force(self) -> float:
        """Largest force [N]; of a switch, what it takes to press it."""
        return self.strongest.force

    @property
    def part(self) -> str:
        return self.strongest.part

    @property
    def patch(self) -> str:
        return self.strongest.patch

    def __str__(self) -> str:
        where = f"{self.part} {self.strongest.segment}" if self.strongest.segment else self.patch
        return (
            f"{self.word} on {where.replace('_', ' ')}, {self.force:.1f} N, {self.end - self.onset:.1f} s, "
            f"{100.0 * self.certainty:.0f} % sure"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """The memory of `TouchWords`."""

    words: tuple[TouchWord, ...] = ()
    """The latest words, the newest last."""
    new: tuple[TouchWord, ...] = ()
    """The words of this step."""
    tracks: Tracks = field(default_factory=Tracks)
    """Touches that are not over."""
    head: HeadTouch = field(default_factory=HeadTouch)
    """What is done to the switches of a NAO's head."""


@dataclass(frozen=True)
class TouchWords(Capability[Heard]):
    """Tells touches as words. Raises TciError for a setting out of range, DescriptionError for a file that is
    no recogniser.

    It claims no part, so it goes beside anything: `tci.Arbiter([TouchWords(), tci.WithdrawalReflex()])`.
    """

    needs = (Need("skin on any part"),)
    recogniser: str = ""
    """File of a recogniser that was trained anew (`tci words train`); empty for that of TCI."""
    least: float = 0.5
    """Certainty below which a touch is told as `other`. Assumed: half."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.least <= 1.0:
            raise TciError(f"touch words: least {self.least}; valid: 0 to 1")
        _recogniser(self.recogniser)

    def init(self, body: GenericBody) -> Heard:
        return Heard()

    def step(
        self, memory: Heard, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Heard]:
        """No orders."""
        now, head = perception.stamp, head_switches(body.robot)
        tracks, over = follow(memory.tracks, perception, body)
        new = [self._word(track, now, body) for track in over if track.strongest.patch != head]
        feels = memory.head
        if head is not None:
            feels, gesture = feel_head(memory.head, head, perception, body)
            if gesture is not None:
                name, sure = (gesture.name, 1.0) if gesture.name else (OTHER, 0.0)
                new.append(TouchWord(name, sure, gesture.strongest, gesture.onset, gesture.felt, now))
        if new:
            return (), Heard((*memory.words, *new)[-KEPT:], tuple(new), tracks, feels)
        return (), replace(memory, tracks=tracks, new=(), head=feels)

    def claims(self, memory: Heard) -> frozenset[str]:
        """Nothing: it only listens."""
        return frozenset()

    def notes(self, memory: Heard) -> tuple[str, ...]:
        """The words of this step."""
        return tuple(map(str, memory.new))

    def words_on(self, patch: str, body: GenericBody) -> tuple[str, ...]:
        """The words that can be told on a patch, beside `other`. Skin with few channels has fewer."""
        found = body.robot.patch(patch)
        if patch == head_switches(body.robot):
            return tuple(GESTURES)
        if found.sensor.switch:
            return SWITCH_WORDS
        words = _recogniser(self.recogniser).words
        if is_few(found):
            words = tuple(dict.fromkeys(FEW_WORDS.get(word, word) for word in words))
        return tuple(word for word in words if word != OTHER)

    def _word(self, track: Track, now: float, body: GenericBody) -> TouchWord:
        rows, patch = track.rows(), body.robot.patch(track.strongest.patch)
        if patch.sensor.switch:
            word, certainty = SWITCH_WORDS[_longest(rows["time"], rows["force"]) > HELD], 1.0
        else:
            recogniser = _recogniser(self.recogniser)
            chances = recogniser.probabilities(features(rows, track.own_speed)[None])[0].tolist()
            among = dict(zip(recogniser.words, chances, strict=True))
            if is_few(patch):
                among = merged(among)
            word = max(among, key=lambda one: among[one])
            if among[word] < self.least:
                word = OTHER
            certainty = among.get(word, 0.0)
        return TouchWord(word, certainty, track.strongest, track.onset, track.felt, now)


def _longest(times: Array, force: Array) -> float:
    """Length [s] of the longest press of a switch."""
    begins, longest = None, 0.0
    for time, pressed in zip(times.tolist(), (force > 0.0).tolist(), strict=True):
        begins = None if not pressed else time if begins is None else begins
        longest = max(longest, 0.0 if begins is None else time - begins)
    return longest


@lru_cache(maxsize=8)
def _recogniser(path: str) -> Recogniser:
    return read_recogniser(path or OWN)
