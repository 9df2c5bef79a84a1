"""A receptive field from motion capture of a person who was touched: the place of the touch, and the motion
that the arm made, as §4.1 of the paper says that base motions come about."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tci.capabilities.fields import ReceptiveField, default_fields, load_fields
from tci.errors import CommandError
from tci.gestures.gesture import Gesture
from tci.messages import LimbPlace
from tci.messages.frames import Array
from tci.robot.generic_arm import JOINTS, Side, limb_direction, segment_rotation
from tci.skin.contacts import Measure
from tci.touches.places import limb_place_of

LASTS = 1.5
"""Longest time [s] between a touch and the end of the withdrawal. People who are poked at the arm take 0.3 to
1 s."""
STARTS, LEAST = 0.2, float(np.deg2rad(20.0))
"""Without a time of the touch, the withdrawal starts where the arm first has this fraction of its largest
speed. A file whose arm moves less than `LEAST` [rad] in any joint shows no withdrawal."""
TOWARDS = 0.1
"""Part of the touched place's way that may lead out of the skin: it moved along the skin. Assumed: nobody
captures directions better than by 6 degrees."""
RADIUS = 0.25
"""Radius [limb lengths] of a learnt field: that of the default fields."""


@dataclass(frozen=True, slots=True)
class Learnt:
    """A field, and what of the file it comes from."""

    field: ReceptiveField
    side: Side
    start: float
    """[s] in the file."""
    end: float
    """[s] in the file: the arm is farthest from where it was at the start."""


def learn_field(gesture: Gesture, words: str, name: str, *, at: float | None = None) -> Learnt:
    """The field of a person who was touched at a place in plain words, such as `left forearm outside`.

    Args:
        gesture: Motion of the person.
        words: Place on an arm.
        name: Of the field.
        at: Time [s] of the touch; None for where the arm begins to move.

    Raises CommandError for a place that is on no arm, a time outside the file, or an arm that does not move,
    or moves towards the touch.
    """
    side, place = limb_place_of(words)
    angles = gesture.postures.get(f"{side}_arm")
    if angles is None:
        raise CommandError(
            f"the file has no {side} arm, which {words!r} is on; valid: {', '.join(gesture.postures)}"
        )
    if at is not None and not 0.0 <= at < gesture.duration:
        raise CommandError(f"touched at {at:g} s; valid: 0 to {gesture.duration:g} s, the file's duration")
    start = _start(gesture.times, angles) if at is None else int(np.searchsorted(gesture.times, at))
    within = (gesture.times >= gesture.times[start]) & (gesture.times <= gesture.times[start] + LASTS)
    hands = np.array([_hand(posture, side) for posture in angles])
    away = np.where(within, np.linalg.norm(hands - hands[start], axis=1), -1.0)
    turned = np.where(within, np.abs(angles - angles[start]).max(axis=1), -1.0)
    end = int(np.argmax(away + 1e-3 * turned))
    motion = angles[end] - angles[start]
    if np.abs(motion).max() < LEAST:
        raise CommandError(
            f"the {side} arm turns by at most {np.rad2deg(np.abs(motion).max()):.1f} degrees within "
            f"{LASTS:g} s of {gesture.times[start]:.2f} s: no withdrawal; "
            f"valid: {np.rad2deg(LEAST):.0f} degrees or more"
        )
    out, way = _way_out(angles[start], angles[end], side, place)
    if out > TOWARDS * way:
        raise CommandError(
            f"{words!r} goes towards whoever touches it, by {50.0 * out:.0f} % of the arm's length from "
            f"{gesture.times[start]:.2f} to {gesture.times[end]:.2f} s: no withdrawal; valid: a motion away "
            "from the touch, so another --place or another time of the touch (--at)"
        )
    learnt = default_fields()[0].model_copy(update={
        "name": name, "segment": place.segment, "u": place.u, "theta": place.theta, "radius": RADIUS,
        "motion": tuple(motion.tolist()),
    })  # fmt: skip
    return Learnt(learnt, side, float(gesture.times[start]), float(gesture.times[end]))


def _start(times: Array, angles: Array) -> int:
    speed = np.abs(np.diff(angles, axis=0) / np.diff(times)[:, None]).max(axis=1)
    return int(np.argmax(speed >= STARTS * speed.max()))


def _hand(posture: Array, side: Side) -> Array:
    """Hand (3,) relative to the shoulder, of an arm whose segments both have the length 1."""
    return _point(posture, side, "forearm", 1.0)


def _point(posture: Array, side: Side, segment: str, u: float) -> Array:
    """A place (3,) on the axis of the same arm."""
    upper, fore = (segment_rotation(name, posture, side, axial=True) for name in ("upper_arm", "forearm"))
    point: Array = -u * upper[:, 2] if segment == "upper_arm" else -upper[:, 2] - u * fore[:, 2]
    return point


def _way_out(before: Array, after: Array, side: Side, place: LimbPlace) -> tuple[float, float]:
    """How far the touched place of the same arm goes along its outward normal, and its whole way."""
    begin, end = (_point(one, side, place.segment, place.u) for one in (before, after))
    normal = segment_rotation(place.segment, before, side) @ limb_direction(place.theta, side)
    return float((end - begin) @ normal), float(np.linalg.norm(end - begin))


def add_field(learnt: ReceptiveField, path: Path) -> int:
    """Adds a field to a TOML file of fields, or makes the file. Returns the number of its fields.

    Raises DescriptionError if the file is none of fields, and CommandError if it has the field's name.
    """
    text = path.read_text(encoding="utf-8") if path.exists() else _forces()
    known = [one.name for one in load_fields(path)] if path.exists() else []
    if learnt.name in known:
        raise CommandError(f"{path} has a field {learnt.name}; valid: another --name")
    motion = ", ".join(f"{angle:.1f}" for angle in np.rad2deg(learnt.motion))
    lines = [
        "", "[[field]]", f'name = "{learnt.name}"', f'segment = "{learnt.segment}"', f"u = {learnt.u:g}",
        f"theta_deg = {np.rad2deg(learnt.theta):g}", f"radius = {learnt.radius:g}",
        f"motion_deg = [{motion}]",
    ]  # fmt: skip
    path.write_text(text.rstrip("\n") + "\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return len(known) + 1


def _forces() -> str:
    """The forces of the default fields, for a new file."""
    lines = [f"# Base motions from people. motion_deg: {', '.join(JOINTS)}."]
    measures: tuple[Measure, ...] = ("total", "weighted", "peak")
    for measure in measures:
        like = default_fields(measure=measure)[0]
        lines += [
            f"[force.{measure}]",
            f"threshold_n = {like.threshold:g}",
            f"saturation_n = {like.saturation:g}",
        ]
    return "\n".join(lines) + "\n"
