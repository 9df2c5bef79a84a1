"""The options `--touch` and `--touches`: people who touch a simulated robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tci.body.generic_body import GenericBody
from tci.cli.console import console
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError
from tci.messages import JointReading
from tci.robot.description import Robot
from tci.touches.kinds import Kind
from tci.touches.laid import LaidTouches
from tci.touches.places import NoSkinError, find_spot
from tci.touches.planned_touch import PlannedTouch
from tci.touches.touch import Touch

if TYPE_CHECKING:
    from tci.simulation.hand_model import PersonModel
    from tci.simulation.world import World

AFTER = 1.5
"""Time [s] for which a run goes on after the last touch, if --duration does not say it: the time of a
withdrawal and of the way back. Assumed."""
FELT = 0.2
"""Fraction of a touch on taxels below which it is told that the robot feels little of it. Assumed: contacts
are not corrected for less (the least fill factor is 0.15)."""


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """Touches that a command asked for, planned on its robot."""

    robot: Robot
    planned: tuple[PlannedTouch, ...]
    shares: tuple[float, ...]
    """Fraction of each touch that falls on taxels."""
    people: Sequence[PersonModel]
    """Those whom it takes."""
    left_out: tuple[Touch, ...] = ()
    """Touches of a file at places of which this robot feels none."""

    @property
    def end(self) -> float:
        """Time [s] after the start at which a run may end."""
        return max(one.end for one in self.planned) + AFTER

    def begin(self, driver: Driver) -> None:
        assert isinstance(driver, SimulatedDriver)  # `options` refuses others
        driver.world.touch_as_planned(self.planned)

    def options(self, via: str) -> dict[str, Any]:
        """Options of the driver. Raises CommandError if the robot is not simulated."""
        if via != "sim":
            raise CommandError(f"--touch and --touches need a simulated robot, not {via}; valid: --via sim")
        return {"people": self.people}

    def tell(self) -> None:
        """Prints one line for each touch, and what the robot can't feel of it."""
        tell_rows(self.robot, self.rows())
        tell_left_out(self.robot, self.not_here())

    def missed(self, driver: Driver) -> list[str]:
        """Touches for which a hand found no room, with the reason."""
        assert isinstance(driver, SimulatedDriver)
        hands = [hand for person in driver.world.people for hand in person.hands]
        return [f"{time:.3f} s: {reason}" for hand in hands for time, reason in hand.missed]

    def not_done(self, driver: Driver) -> list[str]:
        """What a run that began with these touches left out, with the reason: touches after its end, and
        those of `missed`."""
        assert isinstance(driver, SimulatedDriver)
        late = sorted({one.onset for one in self.planned if one.onset >= driver.world.time})
        short = f"the run ended before; valid: --duration {ceil(self.end)} or more, or none"
        reasons = [f"{onset:.3f} s: {short}" for onset in late] + self.missed(driver)
        return [f"a hand did not touch at {one}" for one in reasons]

    def to_json(self, driver: Driver) -> dict[str, Any]:
        return {
            "touches": self.rows(), "left_out": self.not_here(), "missed_touches": self.missed(driver)
        }  # fmt: skip

    def not_here(self) -> list[str]:
        """Words for each of `left_out`."""
        return [f"{one.kind} {one.place}" for one in self.left_out]

    def rows(self) -> list[dict[str, Any]]:
        """What begins, one row of JSON values for each touch."""
        return [
            {
                "kind": one.kind.name, "place": one.touch.place, "patch": one.patch,
                "onset_s": round(one.onset, 4), "end_s": round(one.end, 4), "force_N": round(one.peak, 4),
                "on_taxels": round(share, 3),
            }
            for one, share in zip(self.planned, self.shares, strict=True)
        ]  # fmt: skip


def tell_rows(robot: Robot, rows: Sequence[Mapping[str, Any]]) -> None:
    """Prints one line for each touch (`Asked.rows`), and what the robot can't feel of it."""
    for row in rows:
        begin, end, on_taxels = row["onset_s"], row["end_s"], row["on_taxels"]
        lasts = f"{row['force_N']:.3g} N for {end - begin:.2f} s"
        words = f"{begin:8.3f} s  {row['kind']} {row['place']}, on {row['patch']}: {lasts}"
        console.print(words, style="dim", highlight=False, markup=False)
        if on_taxels < FELT and not robot.patch(row["patch"]).through_joints:
            few = f"only {100 * on_taxels:.0f} % of it falls on taxels"
            words = f"{few}; places with skin: tci touches {robot.name}"
            console.print(words, style="yellow", highlight=False, markup=False)


def tell_left_out(robot: Robot, left_out: Sequence[str]) -> None:
    """Prints which touches of a file have no place on this robot (`Asked.not_here`)."""
    if left_out:
        words = f"left out, since {robot.name} has no skin there: {', '.join(left_out)}"
        words += f"; its places: tci touches {robot.name}"
        console.print(words, style="yellow", highlight=False, markup=False)


def felt_words(robot: Robot, patch: str, felt: float, asked: float) -> str:
    """What a patch felt of a touch with the force `asked` [N]. A switch only knows that it is pressed: the
    force `felt` [N] of its contact is the one that closes it."""
    if robot.patch(patch).sensor.switch:
        return f"{'pressed' if felt else 'not pressed'}, by {asked:.3g} N"
    return f"felt {felt:.2g} N of {asked:.3g} N"


def example_touch(world: World) -> str:
    """A line of words for a touch that this robot can feel now, and for which a hand has room; empty if there
    is none."""
    from tci.simulation.touching import paths_of
    from tci.touches.places import place_words
    from tci.touches.planned_touch import plan

    body = GenericBody(world.robot)
    places = [*place_words(body), *(patch.name for patch in body.robot.patches)]
    stroked = [place for place in places if place.startswith("left forearm")][:1]
    tried = ["stroke 'left forearm' 3N 8cm/s" for _ in stroked] + [f"press '{place}' 3N" for place in places]
    hand = world.person().right
    for words in tried:
        (planned,) = plan(body, words, joints=world.joints())
        with suppress(TciError):  # no room
            for path in paths_of(world.robot, planned):
                hand.touch(path)
                hand.retire()
            return words
    return ""


def ask(
    robot: Robot,
    words: Sequence[str],
    file: Path | None,
    *,
    body: GenericBody | None = None,
    joints: JointReading | None = None,
) -> Asked | None:
    """The touches of both options on a robot; None if neither is given. Of a file those are left out at
    whose place this robot has no skin, unless it has none for any of them: the same file is for all robots.

    Args:
        robot: the robot.
        words: lines of words.
        file: a sequence of touches.
        body: the robot's body, if there is one already.
        joints: its posture, by default the initial one.

    Raises the errors of `read_touches` and `plan`.
    """
    if not words and file is None:
        return None
    from tci.simulation.touching import people_for
    from tci.touches.events import kinds_beside
    from tci.touches.kinds import KINDS
    from tci.touches.planned_touch import plan

    body, kinds = body or GenericBody(robot), KINDS if file is None else kinds_beside(file)
    here, left_out = ([], []) if file is None else _for_this_robot(file, body, kinds)
    planned = plan(body, [*here, *words], kinds=kinds, joints=joints)
    laid = LaidTouches(body, planned)
    shares = tuple(laid.share(number) for number in range(len(planned)))
    return Asked(robot, planned, shares, people_for(planned), tuple(left_out))


def _for_this_robot(
    file: Path, body: GenericBody, kinds: Mapping[str, Kind]
) -> tuple[list[Touch], list[Touch]]:
    """The touches of a file at places that this robot has, and those at places where it lacks skin."""
    from tci.touches.events import read_touches

    here, left_out = list[Touch](), list[Touch]()
    for touch in read_touches(file, kinds=kinds):
        try:
            find_spot(body, touch.place)
            here.append(touch)
        except NoSkinError:
            left_out.append(touch)
        except TciError:
            read_touches(file, body=body, kinds=kinds)  # raises it, with all other faults
    if not here:
        read_touches(file, body=body, kinds=kinds)
    return here, left_out
