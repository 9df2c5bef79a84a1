"""Places in plain words: `left forearm outside`, `back of right hand`, `belly`, and names of patches.

The words mean the same on every robot: a `LimbPlace` or a `Landmark`, by the table `places.csv`. Which of
them a robot has follows from its skin.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.places import Place
from tci.errors import TciError, UnknownNameError
from tci.messages import JointReading, Landmark, LimbPlace
from tci.messages.frames import Array, read_only
from tci.robot.description import GenericPart, Patch
from tci.robot.generic_arm import Side
from tci.robot.generic_fingers import FINGERS
from tci.robot.joint_map import initial_position

FACING = 0.2
"""Least cosine between a taxel's normal and the direction of a landmark on a skin without faces, as for
landmarks on other skin."""
COVERED = 0.008
"""Distance [m] of the nearest taxel up to which words find skin at a place. Assumed: a little more than the
distance of taxels on a NAO or an iCub."""
WIDE = 0.02
"""Distance [m] around a place in which its taxels are counted. Assumed: about a palm."""
_ALONG = (0.6, 0.5, 0.7, 0.4, 0.8, 0.3, 0.9, 0.2)
"""Where along a limb a place is looked for if the words don't say it."""
_TAXEL = re.compile(r"(\S+) taxel (\d+)")
_NUMBER = r"(\d*\.?\d+)"
_TAIL = re.compile(rf"(.*?)(?:\s+(-?\d+(?:\.\d+)?)deg)?(?:\s+{_NUMBER}(?:\.\.{_NUMBER})?)?")


@dataclass(frozen=True, slots=True)
class _Row:
    words: str
    kind: str
    segment: str
    degrees: float | None
    u: float | None
    towards: tuple[float, float, float] | None


def _rows() -> tuple[_Row, ...]:
    with Path(__file__).with_name("places.csv").open(encoding="utf-8", newline="") as file:
        return tuple(
            _Row(
                row["words"], row["kind"], row["segment"],
                float(row["degrees"]) if row["degrees"] else None,
                float(row["u"]) if row["u"] else None,
                (*map(float, row["towards"].split()),) if row["towards"] else None,  # type: ignore[arg-type]
            )
            for row in csv.DictReader(file)
        )  # fmt: skip


ROWS = _rows()


@dataclass(frozen=True, slots=True, eq=False)
class Spot:
    """A place that was found on one robot's skin."""

    place: Place
    """Point of the skin; in the middle of `along`, if that is given."""
    part: str
    segment: str
    along: tuple[float, float] | None = None
    """From where to where along the limb; on a patch that is on no limb, along `axis_of` (0..1)."""


def place_words(body: GenericBody) -> list[str]:
    """All words that name a place on this robot's skin, without names of patches."""
    return [words for words, row, part in _named(body) if _on_part(body, part, row, None, None) is not None]


def words_of(part: GenericPart, place: LimbPlace) -> str:
    """The words for a point on an arm: `left forearm 37deg 0.62`."""
    segment = place.segment.replace("_", " ")
    return f"{part.side} {segment} {degrees(place.theta):.0f}deg {min(max(place.u, 0.0), 1.0):.2f}"


class NoSkinError(TciError):
    """Words name a place that other robots feel, and this one does not."""


def find_spot(body: GenericBody, words: str, joints: JointReading | None = None) -> Spot:
    """The point of a robot's skin that `words` name, in the posture `joints` (by default the initial one).

    Raises UnknownNameError with all places of this robot for words that name no place, and NoSkinError if
    there is no skin at the point.
    """
    joints = joints or initial_joints(body)
    words = " ".join(words.split())
    if match := _TAXEL.fullmatch(words):
        patch = body.robot.patch(match[1])
        surface, taxel = body.skin.surfaces[patch.name], int(match[2])
        if taxel >= len(surface.positions):
            raise UnknownNameError(f"taxel of {patch.name}", match[2], [f"0 to {len(surface.positions) - 1}"])
        return _at_taxel(body, patch, taxel)
    name, theta, u, along = _split(words)
    spot = _patch_spot(body, name, u) or _word_spot(body, name, theta, u, joints)
    return Spot(spot.place, spot.part, spot.segment, along)


def _split(words: str) -> tuple[str, float | None, float | None, tuple[float, float] | None]:
    """Name, angle [rad] around the limb, place along it, and from where to where, as far as `words` say."""
    match = _TAIL.fullmatch(words)
    assert match is not None  # the pattern fits any words
    name, angle, first, last = match.groups()
    theta = None if angle is None else radians(float(angle))
    along = None if last is None else (float(first), float(last))
    u = float(first) if along is None and first is not None else None if along is None else sum(along) / 2.0
    if u is not None and (beyond := max(u, *(along or (0.0,)))) > 1.0:
        raise TciError(f"place {words!r}: {beyond:g} along the limb; valid: 0 to 1")
    return name, theta, u, along


def limb_place_of(words: str) -> tuple[Side, LimbPlace]:
    """The side and the place on a generic arm that `words` name, of no robot in particular. Raises
    UnknownNameError for words that name no place on an arm."""
    name, theta, u, _ = _split(" ".join(words.split()))
    sides: tuple[Side, ...] = ("left", "right")
    arms = {
        row.words.format(side=side): (side, row) for row in ROWS if row.degrees is not None for side in sides
    }
    if name not in arms:
        raise UnknownNameError("place on an arm", name, list(arms))
    side, row = arms[name]
    assert row.degrees is not None  # selected above
    assert row.u is not None  # each row with an angle has a `u`
    theta = radians(row.degrees) if theta is None else theta
    return side, LimbPlace(row.segment, row.u if u is None else u, theta)


def _patch_spot(body: GenericBody, name: str, u: float | None) -> Spot | None:
    patch = next((one for one in body.robot.patches if one.name == name), None)
    if patch is None:
        return None
    surface = body.skin.surfaces[name]
    positions = surface.positions
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2.0
    if u is not None and len(positions) > 1:
        axis = axis_of(body, patch)
        middle = positions.mean(axis=0)
        x = (positions - middle) @ axis
        middle = middle + (x.min() + u * np.ptp(x)) * axis
    return _at_taxel(body, patch, int(np.linalg.norm(positions - middle, axis=1).argmin()))


def axis_of(body: GenericBody, patch: Patch) -> Array:
    """Unit vector (3,) along a patch that is on no limb: on a finger towards its tip, also around one that
    taxels enclose; elsewhere the patch's longest axis."""
    positions = body.skin.surfaces[patch.name].positions
    if patch.segment in FINGERS:
        segment = body.robot.part(patch.part).segment(patch.segment)
        ahead: Array = positions.mean(axis=0) - segment.origin
        length = float(np.linalg.norm(ahead))
        if segment.link == patch.link and length > COVERED:
            return ahead / length
    return long_axis(positions)


def long_axis(positions: Array) -> Array:
    """Unit vector (3,) along the longest axis of a patch, that of the first principal component."""
    axis: Array = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)[2][0]
    return axis * (1.0 if axis[np.abs(axis).argmax()] < 0.0 else -1.0)  # limbs hang along -z


def _at_taxel(body: GenericBody, patch: Patch, taxel: int) -> Spot:
    surface = body.skin.surfaces[patch.name]
    place = Place(patch.name, read_only(surface.positions[taxel]), read_only(surface.normals[taxel]))
    return Spot(place, patch.part, patch.segment)


def _word_spot(
    body: GenericBody, name: str, theta: float | None, u: float | None, joints: JointReading
) -> Spot:
    known = [(row, part) for words, row, part in _named(body) if _fits(words, name)]
    spots = [_on_part(body, part, row, theta, u, joints) for row, part in known]
    found = [(_taxels_around(body, spot.place), -n, spot) for n, spot in enumerate(spots) if spot is not None]
    if found:
        return max(found, key=lambda one: one[:2])[2]
    if known and (theta is not None or u is not None):
        where = f"{'' if theta is None else f'{degrees(theta):g}deg '}{'' if u is None else f'{u:g}'}".strip()
        raise NoSkinError(f"{body.robot.name} has no skin on {name!r} at {where}; valid: {_valid(body)}")
    every = {words for side in ("left", "right") for row in ROWS for words in [row.words.format(side=side)]}
    if known or name in every or any(_fits(words, name) for words in every):
        raise NoSkinError(f"{body.robot.name} has no skin on {name!r}; valid: {_valid(body)}")
    raise UnknownNameError("place", name, _valid_names(body))


def _valid_names(body: GenericBody) -> list[str]:
    return [*place_words(body), *(patch.name for patch in body.robot.patches)]


def _valid(body: GenericBody) -> str:
    return ", ".join(_valid_names(body))


def _fits(words: str, name: str) -> bool:
    """True for the words themselves, and for a limb without the word for its side of it: `left forearm`."""
    return name == words or (name == words.rpartition(" ")[0] and words.rpartition(" ")[2] in _FACES)


_FACES = ("outside", "back", "inside", "front")


def _named(body: GenericBody) -> Iterator[tuple[str, _Row, GenericPart]]:
    """The words of all places on parts that this robot has, once each alternative."""
    for row in ROWS:
        for part in body.robot.parts:
            if part.kind == row.kind:
                yield row.words.format(side=part.side or ""), row, part


def _on_part(
    body: GenericBody, part: GenericPart, row: _Row, theta: float | None, u: float | None,
    joints: JointReading | None = None,
) -> Spot | None:  # fmt: skip
    """The point of a part at a place of the table; None if it has no skin there."""
    patches = [p for p in body.robot.patches if p.part == part.name and p.segment == row.segment]
    if not patches:
        return None
    if row.degrees is not None:
        theta = radians(row.degrees) if theta is None else theta
        tried = (u,) if u is not None else (row.u, *_ALONG) if row.u in _ALONG else (row.u,)
        for one in tried:
            assert one is not None  # each row with an angle has a `u`
            try:
                place = body.place(
                    part.name, LimbPlace(row.segment, one, theta), joints or initial_joints(body)
                )
            except TciError:
                continue
            if u is not None or _is_covered(body, place):
                return Spot(place, part.name, row.segment)
        return None
    if row.towards is None:
        return _patch_spot(body, patches[0].name, u)
    try:
        place = body.landmark(part.name, Landmark(row.segment, row.towards))
    except TciError:
        return _without_faces(body, part, patches, row.towards)
    return Spot(place, part.name, row.segment)


def _is_covered(body: GenericBody, place: Place) -> bool:
    distances = np.linalg.norm(body.skin.surfaces[place.patch].positions - place.p_L, axis=1)
    return bool(distances.min() < COVERED)


def _taxels_around(body: GenericBody, place: Place) -> float:
    """Fraction of the surface within `WIDE` that taxels cover, in steps of a quarter: of several sides of a
    limb the first one that is well covered is taken."""
    surface = body.skin.surfaces[place.patch]
    near = np.linalg.norm(surface.positions - place.p_L, axis=1) < WIDE
    return float(np.round(4.0 * surface.areas[near].sum() / (np.pi * WIDE**2)))


def _without_faces(
    body: GenericBody, part: GenericPart, patches: Iterable[Patch], towards: tuple[float, float, float]
) -> Spot | None:
    """The taxel that is farthest in a direction, among switches and other taxels without faces."""
    best: tuple[float, Spot] | None = None
    R_TL = {patch.link: body.skin.link_pose(patch.link, initial_joints(body))[:3, :3] for patch in patches}
    for patch in patches:
        surface = body.skin.surfaces[patch.name]
        if len(surface.faces):
            continue
        side = -1.0 if part.side == "right" else 1.0
        direction = R_TL[patch.link].T @ (np.array(towards) * [1.0, side, 1.0])
        direction /= np.linalg.norm(direction)
        out = np.where(
            surface.normals @ direction > FACING,
            (surface.positions - surface.positions.mean(axis=0)) @ direction,
            -np.inf,
        )
        taxel = int(out.argmax())
        if np.isfinite(out[taxel]) and (best is None or out[taxel] > best[0]):
            best = float(out[taxel]), _at_taxel(body, patch, taxel)
    return None if best is None else best[1]


def initial_joints(body: GenericBody) -> JointReading:
    """The robot at rest in its initial posture."""
    position = read_only(initial_position(body.robot))
    return JointReading(0.0, 0, position, read_only(np.zeros(len(position))))
