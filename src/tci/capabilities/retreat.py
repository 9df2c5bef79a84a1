"""Checks a motion in response to a touch: the motion must not press the skin into a touching object.

A capability that responds to touches must call this check before it moves a part. The direction away from the
object is computed from the normals of the contacts. Receptive fields are not used, so the check is
independent of the shape of the generic body.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.body.generic_body import GenericBody
from tci.messages import Mode, Perception
from tci.messages.frames import Array, read_only

PRESSED = 1e-5
"""Depth [m] up to which a motion into an object counts as tangential to the skin. Assumed: larger than
rounding errors."""
ENTERED = 1e-4
"""Depth [m] up to which skin may enter a touching object. Assumed: about the error of the contact point."""
LEAST = 1e-3
"""Least distance [m] by which the contact point must move away from the object. Assumed: a smaller distance
would not end the contact with a soft object."""
STEEP = 0.2
"""Least ratio of the motion away from the object to the tangential motion. Assumed: the friction coefficient
of skin is larger than this value, so a motion with a smaller ratio would drag the object along."""

BEGUN = 0.1
"""Fraction of a motion at whose end its direction is taken first: a path that begins along the object is
refused. Assumed: short against the way, long against rounding."""
REACH = np.deg2rad(15.0)
"""Largest motion [rad] of a joint that `nowhere` tries: the base motions of the arms."""
SHARES = read_only([-1.0, -0.5, 0.0, 0.5, 1.0])
"""Fractions of `REACH` of each joint that `nowhere` combines."""
AT_ONCE = 100
"""Motions that `nowhere` tries together, the steepest first: all 3125 of an arm take longer than a period."""


def why_not(
    perception: Perception,
    body: GenericBody,
    part: str,
    target: Array,
    *,
    mode: Mode = Mode.POSITION,
    answers: Sequence[int] = (),
    least: float = LEAST,
    driven: bool = False,
) -> str:
    """Returns the reason why a part must not move to generic angles `target` (n,) [rad].

    The text is empty if the part may move. At no point of its path may the motion press a contact, on any
    part, into the touching object. The motion must not bring other skin into this object either;
    `Retreat.along` describes the assumed shape of the object. `answers` are the contacts to which the motion
    responds, as indices in `perception.contacts`. At least one of these contacts must move away from its
    object, by `least` [m] or more. `mode` is the control mode of the motion. Set `driven` if the motion is a
    velocity that the capability commands anew in each period. `target` is then the posture that this velocity
    reaches after 0.1 s (`tci.body.retreat.AHEAD`).
    """
    paths = body.retreat(perception, part, target, mode, driven=driven)
    if not paths.size:
        return ""
    inwards, across, entered = paths.tolist()
    if min(map(min, inwards)) < -PRESSED:
        deepest = -paths[0].min(axis=0)
        return (
            f"its motion would press {perception.contacts[int(deepest.argmax())].patch} "
            f"{deepest.max() * 1e3:.2g} mm into the object that touches it; valid: a motion away from it"
        )
    if max(map(max, entered)) > ENTERED:
        deepest = paths[2].max(axis=0)
        return (
            f"its motion would press other skin {deepest.max() * 1e3:.2g} mm into the object that touches "
            f"{perception.contacts[int(deepest.argmax())].patch}; valid: a motion away from it"
        )
    first = ""
    for one in answers:
        why = _why_kept([row[one] for row in inwards], [row[one] for row in across], least)
        if not why:
            return ""
        first = first or why.format(patch=perception.contacts[one].patch)
    return first


def are_hopeless(
    perception: Perception,
    body: GenericBody,
    part: str,
    targets: Array,
    answers: Sequence[Sequence[int]],
) -> list[bool]:
    """Returns m values. A value is True if `why_not` would refuse the motion because of the posture at its
    end.

    This check is fast, but does not examine the path. So motions with the result False must also be checked
    by `why_not`. `targets` (m, n) [rad] are the ends of the motions, and `answers` the contacts to which each
    motion responds.
    """
    inwards = body.retreat_at_ends(perception, part, targets)[0]
    pressed = inwards.min(axis=1, initial=np.inf) < -PRESSED
    return [
        bool(one) or all(way[contact] < LEAST for contact in own)
        for one, way, own in zip(pressed, inwards, answers, strict=True)
    ]


def hopeful(
    perception: Perception, body: GenericBody, part: str, targets: Array, answers: Sequence[int]
) -> list[int]:
    """Indices of the m motions to `targets` (m, n) [rad] that `are_hopeless` doesn't rule out, those first
    that take the contacts `answers` farthest away."""
    inwards = body.retreat_at_ends(perception, part, targets)[0]
    away = inwards[:, answers].max(axis=1)
    fine = (inwards.min(axis=1) >= -PRESSED) & (away >= LEAST)
    return [k for k in np.argsort(-away, kind="stable").tolist() if fine[k]]


def nowhere(perception: Perception, body: GenericBody, part: str, answers: Sequence[int]) -> bool:
    """True if no motion of `part` by up to `REACH` in each joint, of a grid of them, begins and ends away
    from what touches the contacts `answers`: then the posture must change, not the answer."""
    origin = perception.posture[part]
    jacobians = [body.jacobian(perception, perception.contacts[one], part) for one in answers]
    moving = np.flatnonzero(np.abs(jacobians).max(axis=(0, 1)) > 1e-6)
    ways = np.zeros((len(SHARES) ** len(moving), origin.size))
    grid = np.indices((len(SHARES),) * len(moving)).reshape(len(moving), len(ways)).T
    ways[:, moving] = REACH * SHARES[grid]
    # the linear motion, which differs from the true one by a few degrees, tells which are steep, and how
    steepness = np.full(len(ways), -np.inf)
    for one, jacobian in zip(answers, jacobians, strict=True):
        moved, normal = ways @ jacobian.T, perception.contacts[one].n_T
        away = -moved @ normal
        across = np.linalg.norm(moved + np.outer(away, normal), axis=1)
        steepness = np.maximum(steepness, away / (across + 1e-9))
    order = np.argsort(-steepness, kind="stable")[: np.count_nonzero(steepness >= 0.5 * STEEP)]
    return not any(
        _leaves(perception, body, part, ways[some], answers)
        for some in (order[k : k + AT_ONCE] for k in range(0, len(order), AT_ONCE))
    )


def _leaves(
    perception: Perception, body: GenericBody, part: str, ways: Array, answers: Sequence[int]
) -> bool:
    """True if any of `ways` (k, n) [rad] begins and ends away from what touches one of the contacts
    `answers`, and presses nobody."""
    kept = np.ones((len(ways), len(answers)), bool)
    for share, least in ((BEGUN, -np.inf), (1.0, LEAST)):
        inwards, across = body.retreat_at_ends(perception, part, perception.posture[part] + share * ways)
        own = inwards[:, answers]
        kept &= (
            (own >= STEEP * across[:, answers]) & (own >= least) & (inwards.min(axis=1) >= -PRESSED)[:, None]
        )
        ways, kept = ways[kept.any(axis=1)], kept[kept.any(axis=1)]
    return bool(len(ways))


def _why_kept(inwards: Sequence[float], across: Sequence[float], least: float) -> str:
    """Why a contact point does not move far enough away from the object, or not directly enough; empty if it
    does.

    Args:
        inwards: Displacements (k,) [m] away from the object, at k points of the motion.
        across: Displacements (k,) [m] tangential to the skin.
        least: Least displacement [m] away from the object at the end.
    """
    if inwards[-1] < least:
        return (
            f"its motion would take {{patch}} {inwards[-1] * 1e3:.2g} mm away from the object that touches "
            f"it; valid: {least * 1e3:g} mm or more"
        )
    if any(away < STEEP * aside for away, aside in zip(inwards, across, strict=True)):
        return "its motion would drag {patch} along the object that touches it; valid: a motion away from it"
    return ""
