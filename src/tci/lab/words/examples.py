"""Touches that train a recogniser: of recordings that people labelled, and laid on simulated skins."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.touch_words.features import NAMES, features
from tci.capabilities.touch_words.recogniser import OTHER
from tci.capabilities.touch_words.tracks import Track, Tracks, follow
from tci.errors import CommandError
from tci.lab.words.trials import OTHERS, STRENGTHS, draw, felt
from tci.messages.frames import Array
from tci.robot.like import RobotLike

WORDS = "poke", "tap", "pat", "hit", "press", "stroke", "rub", "scratch", "tickle", "squeeze", "hold"
"""Kinds of touches that the recogniser of TCI is trained for."""
FAULTY = 0.3
"""Fraction of the laid touches that are felt with gains that differ by 20 %, and 5 % of the taxels dead."""
SLACK = 0.3
"""Time [s] by which a label may begin late or end early. Assumed: whoever labels a film is no better."""
LABELS = ".tsv", ".csv", ".txt", ".eaf"


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Touches with their words."""

    features: Array
    """(t, n)"""
    words: tuple[str, ...]
    """(t,)"""
    groups: tuple[str, ...]
    """The file or robot of each (t,): all of a group are left out together."""
    about: str = ""

    @staticmethod
    def of(tracks: Iterable[tuple[Track, str]], group: str, about: str) -> Examples:
        pairs = [(features(track.rows(), track.own_speed), word) for track, word in tracks]
        values = np.array([one for one, _ in pairs]).reshape(-1, len(NAMES))
        return Examples(values, tuple(word for _, word in pairs), (group,) * len(pairs), about)

    def __add__(self, other: Examples) -> Examples:
        return Examples(
            np.concatenate([self.features, other.features]), self.words + other.words,
            self.groups + other.groups, "; ".join(one for one in (self.about, other.about) if one),
        )  # fmt: skip

    @property
    def counts(self) -> dict[str, int]:
        return {word: self.words.count(word) for word in dict.fromkeys(self.words)}


def of_recording(path: str | Path) -> Examples:
    """The touches of a recording, with the labels in the file beside it: `visit.mcap` and `visit.tsv`, or an
    export of BORIS or ELAN. A touch without a label is `other`.

    Raises CommandError without labels or touches, and the errors of `Recording` and `read_touches`.
    """
    from tci.recording.perceived import perceive, recorded_robot
    from tci.recording.recording import Recording
    from tci.touches.events import read_touches

    path = Path(path)
    if not path.is_file():
        raise CommandError(f"{path}: no such file; valid: a recording (.mcap)")
    beside = [path.with_suffix(suffix) for suffix in LABELS if path.with_suffix(suffix).exists()]
    if not beside:
        valid = path.with_suffix(".tsv").name
        raise CommandError(f"{path}: no labels; valid: {valid} beside it (tci log touches)")
    recording = Recording(path)
    found = recorded_robot(recording)
    if found is None:
        raise CommandError(f"{path} names no robot; valid: a recording of tci record")
    body, tracks, over, begun = GenericBody(found), Tracks(), list[Track](), None
    for period in perceive(recording, found):
        begun = period.now if begun is None else begun
        tracks, told = follow(tracks, period.perception, body)
        over += told
    over += [track for track in tracks.touches.values() if not track.told]
    labels = [
        (begun + (one.onset or 0.0), begun + (one.onset or 0.0) + (one.duration or 0.0), one.kind)
        for one in read_touches(beside[0])
    ] if begun is not None else []  # fmt: skip
    if not over:
        raise CommandError(f"{path}: no touch is felt; valid: a recording with touches")
    return Examples.of(
        [(track, _label(track, labels)) for track in over], path.stem, f"{path.name}, {len(over)} touches"
    )


def _label(track: Track, labels: list[tuple[float, float, str]]) -> str:
    """The label that lasts longest during a touch."""
    shared = [
        (min(end + SLACK, track.felt) - max(begin - SLACK, track.onset), kind) for begin, end, kind in labels
    ]
    best = max(shared, default=(0.0, OTHER))
    return best[1] if best[0] > 0.0 else OTHER


def of_laid(
    robot: RobotLike, each: int, *, seed: int = 0, words: Iterable[str] = WORDS,
    progress: Callable[[], None] = lambda: None,
) -> Examples:  # fmt: skip
    """`each` touches of every word, and as many of everything that means nothing, laid on all skin of a robot
    with many taxels, by persons who differ. Raises CommandError for a robot without such skin."""
    body, random = GenericBody(robot), np.random.default_rng(seed)
    patches = [one.name for one in body.robot.skin if one.channels > 12 and not one.sensor.switch]
    if not patches:
        raise CommandError(f"{body.robot.name} has no skin with more than 12 taxels")
    tracks: list[tuple[Track, str]] = []
    strengths = (*STRENGTHS, "normal", "normal")
    for kind in (*words, *OTHERS):
        for _ in range(each):
            trial = draw(
                body, kind, random, patches=patches, who="trained", strengths=strengths, faults=FAULTY
            )
            tracks += [(track, OTHER if kind in OTHERS else kind) for track in felt(trial, body)]
            progress()
    about = f"touches laid on {body.robot.name}, {each} of each kind (seed {seed})"
    return Examples.of(tracks, body.robot.name, about)
