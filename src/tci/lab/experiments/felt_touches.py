"""What a robot feels of each kind of touch, against what the hand truly did and what it was asked to do.

The robot holds its posture, without a reflex. The same touches are laid on the taxels without physics, to
tell how far both agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import TciError
from tci.messages import Perception, Reading
from tci.messages.frames import Array
from tci.robot.like import RobotLike, as_robot
from tci.simulation.world import World
from tci.testing.touched_robot import TouchedRobot
from tci.touches.kinds import KINDS
from tci.touches.laid import LaidTouches
from tci.touches.planned_touch import PlannedTouch, plan
from tci.touches.touch import Touch

PLACE = "left forearm"
PLATEAU = 0.5
"""Fraction of the largest asked force from which a moment counts: while a force rises and falls, a delay of a
few milliseconds is a large error."""
WINDOW = 0.1
"""Time [s] over which speeds are taken. Assumed: a few skin frames."""
SLIDING = ("passes", "strokes")


@dataclass(frozen=True, slots=True)
class FeltTouch:
    """One kind of touch on one robot; medians over its moments."""

    robot: str
    kind: str
    asked_n: float
    """Median asked force; for pulses the asked peak [N]."""
    hand_n: float
    """The same of the hand's contact force in the physics."""
    felt_n: float
    """The same of all contacts together that TCI found [N]."""
    place_mm: float | None
    """Distance along the skin between the felt and the true centre; None if nothing was felt."""
    hand_cm_s: float | None
    """Speed along the skin in the physics; None for a touch that does not slide."""
    felt_cm_s: float | None
    laid_n: float
    """As `felt_n`, for pressure laid without physics."""
    laid_mm: float | None
    """Distance between the centres that were felt of the laid touch and of the hand."""
    on_taxels: float
    """Fraction of the laid touch that falls on taxels."""
    note: str = ""
    """Why the touch was not done."""

    def to_json(self) -> dict[str, object]:
        return asdict(self)


@dataclass(slots=True)
class _Series:
    """Force (t,) [N] and centre (t, 3) [m], NaN without contact, at times (t,) [s]."""

    times: Array
    force: Array
    centre: Array


def measure_touches(
    robot: RobotLike, kinds: Iterable[str] = (), *, place: str = PLACE, seed: int = 0
) -> Iterator[FeltTouch]:
    """Does each kind of touch (default: all that have a generator) once, and yields what was felt of it."""
    robot = as_robot(robot)
    body, world = GenericBody(robot), World(robot, people=1, seed=seed)
    names = tuple(kinds) or tuple(kind.name for kind in KINDS.values() if kind.generator != "none")
    for name in names:
        world.reset()
        (planned,) = plan(body, Touch(name, place), joints=world.joints(), seed=seed)
        laid = _felt(TouchedRobot(robot).feel(Touch(name, place), seed=seed), body, planned.patch)
        try:
            felt, hand = _done(world, body, planned)
        except TciError as error:
            yield FeltTouch(
                robot.name, name, planned.peak, 0.0, 0.0, None, None, None, 0.0, None, 0.0, str(error)
            )
            continue
        yield _compared(robot.name, planned, hand, felt, laid, body)


def _done(world: World, body: GenericBody, planned: PlannedTouch) -> tuple[_Series, _Series]:
    """What was felt and what the hand did."""
    world.touch_as_planned([planned])
    perceiver, period = Perceiver(body), 1.0 / body.robot.patch(planned.patch).rate
    seen = []
    while world.time < planned.end + 0.3:
        world.advance(world.time + period)
        seen.append(perceiver.step(Reading(world.joints(), world.frames()), world.time))
    hands = [hand for person in world.people for hand in person.hands if len(hand.trace)]
    if not hands:
        raise TciError("; ".join(words for _, words in world.people[0].right.missed) or "no hand moved")
    trace = hands[0].trace
    return _felt(seen, body, planned.patch), _Series(trace[:, 0], trace[:, 2], trace[:, 4:7])


def _felt(perceptions: Iterable[Perception], body: GenericBody, patch: str) -> _Series:
    """What was felt on a patch; its centre is that of the forces on all pressed taxels."""
    positions = body.skin.surfaces[patch].positions
    times, forces, centres = [], [], []
    for perception in perceptions:
        own = [contact for contact in perception.contacts if contact.patch == patch]
        times.append(own[0].stamp if own else perception.stamp)
        forces.append(sum(contact.force for contact in own))
        pressed = sum(contact.taxel_forces.sum() for contact in own)
        moment = sum((contact.taxel_forces @ positions[contact.taxels] for contact in own), np.zeros(3))
        centres.append(moment / pressed if own else np.full(3, np.nan))
    return _Series(np.array(times), np.array(forces), np.array(centres))


def _compared(
    robot: str, planned: PlannedTouch, hand: _Series, felt: _Series, laid: _Series, body: GenericBody
) -> FeltTouch:
    asked = planned.force.sum(axis=1)
    moments = planned.times[asked > PLATEAU * asked.max()]
    pulses = planned.kind.generator == "pulses"

    def force(times: Array, values: Array) -> float:
        return float(values.max() if pulses else np.median(np.interp(moments, times, values)))

    at = felt.times[(felt.force > PLATEAU * felt.force.max()) & (felt.force > 0.0)]
    true = _at(hand, at)
    here = _at(felt, at)
    normal = planned.normal[len(planned.times) // 2, 0]
    slides = planned.kind.generator in SLIDING
    return FeltTouch(
        robot=robot,
        kind=planned.kind.name,
        asked_n=force(planned.times, asked),
        hand_n=force(hand.times, hand.force),
        felt_n=force(felt.times, felt.force),
        place_mm=_apart(here, true, normal),
        hand_cm_s=_speed(hand, moments) if slides else None,
        felt_cm_s=_speed(felt, moments) if slides else None,
        laid_n=force(laid.times, laid.force),
        laid_mm=_apart(here, _at(laid, at), normal),
        on_taxels=LaidTouches(body, [planned]).share(0),
    )


def _at(series: _Series, times: Array) -> Array:
    return np.column_stack(
        [np.interp(times, series.times, axis, left=np.nan, right=np.nan) for axis in series.centre.T]
    )


def _apart(one: Array, other: Array, normal: Array) -> float | None:
    """Median distance [mm] of points (t, 3) [m] across a normal (3,)."""
    between = one - other
    between = between - (between @ normal)[:, None] * normal
    distances = np.linalg.norm(between, axis=1)
    distances = distances[np.isfinite(distances)]
    return 1e3 * float(np.median(distances)) if len(distances) else None


def _speed(series: _Series, moments: Array) -> float | None:
    """Median speed [cm/s] of the centre."""
    way = np.linalg.norm(_at(series, moments + WINDOW / 2.0) - _at(series, moments - WINDOW / 2.0), axis=1)
    way = way[np.isfinite(way)]
    return 100.0 * float(np.median(way)) / WINDOW if len(way) else None
