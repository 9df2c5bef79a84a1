"""Inserts mistakes into valid descriptions, one at a time, and judges whether `tci check` finds them.

A mistake counts as found if a message contains its place. It counts as blamed on something else if another
message appears.

Run: python tools/planted.py [--robots g1 nao icub] [--count 30]
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tci.errors import TciError
from tci.lab.commissioning.plausibility import doubts
from tci.lab.experiments.verdict import weight_faults
from tci.messages.frames import rotation_rpy
from tci.robot.catalogue import load_robot
from tci.robot.description import GenericPart, Patch, Robot, Servo, TruncatedCone
from tci.robot.kinematics import KinematicChain, bare_model

Item = TypeVar("Item")


@dataclass(frozen=True)
class Mistake:
    """A description with one inserted mistake."""

    kind: str
    place: str
    """Name that a message about this mistake must contain."""
    robot: Robot


def mistakes(robot: Robot) -> dict[str, list[Mistake]]:
    """Returns every mistake that can be inserted, by kind."""
    found: dict[str, list[Mistake]] = {}
    for kind, place, changes in (
        *_of_limits(robot), *_of_patches(robot), *_of_pairs(robot), *_of_signs(robot), *_of_links(robot),
        *_of_segments(robot), *_of_postures(robot),
    ):  # fmt: skip
        wrong = robot.model_copy(update=changes | {"digest": f"{robot.name} {kind} {place} {len(found)}"})
        found.setdefault(kind, []).append(Mistake(kind, place, wrong))
    return found


def some(robot: Robot, count: int) -> list[Mistake]:
    """Returns `count` mistakes, taken from all kinds in turn."""
    groups = list(mistakes(robot).values())
    chance = random.Random(0)
    for group in groups:
        chance.shuffle(group)
    chosen: list[Mistake] = []
    while len(chosen) < count and any(groups):
        chosen += [group.pop() for group in groups if group]
    return chosen[:count]


def judge(mistake: Mistake) -> tuple[bool, list[str]]:
    """Returns True if a mistake is found, and the messages that are not about this mistake."""
    try:
        words = [*weight_faults(mistake.robot), *doubts(mistake.robot)]
    except TciError as error:
        words = [str(error)]
    about = [one for one in words if mistake.place in one]
    return bool(about), [one for one in words if one not in about]


Change = tuple[str, str, dict[str, object]]


def _of_limits(robot: Robot) -> Iterator[Change]:
    assert robot.model is not None
    model = bare_model(robot.model)
    ranges = {model.joint(j).name: model.jnt_range[j] for j in range(model.njnt) if model.jnt_limited[j]}
    arms = {part.side: part for part in robot.parts if part.kind == "arm"}
    for left, right in zip(arms["left"].servos, arms["right"].servos, strict=True):
        if left.servo is not None and left.id == 0 and robot.servos[left.servo].limits.torque is not None:
            servo = robot.servos[left.servo]
            weak = servo.limits.model_copy(update={"torque": 0.01})
            yield "torque limit of 0.01 N m", servo.name, _servo(robot, servo, weak)
        for one, other in ((left, right), (right, left)):
            if one.servo is None or other.servo is None:
                continue
            servo, limits = robot.servos[one.servo], robot.servos[other.servo].limits
            if limits.lower is None or limits.upper is None:
                continue
            lower, upper = ranges.get(str(servo.joint), (servo.limits.lower, servo.limits.upper))
            if limits.lower < lower - 0.1 or limits.upper > upper + 0.1:
                yield "limits of the other side", servo.name, _servo(robot, servo, limits)
            if upper < 3.0:
                wider = servo.limits.model_copy(update={"upper": float(np.deg2rad(200.0))})
                yield "limit of 200 degrees", servo.name, _servo(robot, servo, wider)


def _of_patches(robot: Robot) -> Iterator[Change]:
    chain = KinematicChain(robot)
    for patch in robot.patches:
        if not patch.name.startswith(("left_upper", "left_fore", "right_upper", "right_fore")):
            continue
        factor = patch.sensor.pascal_per_count
        for times in (-1.0, 1000.0, 0.001):
            sensor = patch.sensor.model_copy(update={"pascal_per_count": factor * times})
            yield f"pascals times {times:g}", patch.name, _patch(robot, patch, sensor=sensor)
        surface = patch.surface
        if hasattr(surface, "r1"):
            wide = surface.model_copy(update={"r1": 2.0 * surface.r1, "r2": 2.0 * surface.r2})
            yield "cone twice as wide", patch.name, _patch(robot, patch, surface=wide)
        for field in ("origin", "xyz"):
            if hasattr(surface, field):
                for axis in range(3):
                    moved = np.array(getattr(surface, field)) + 0.03 * np.eye(3)[axis]
                    off = surface.model_copy(update={field: tuple(moved.tolist())})
                    yield "skin 30 mm off", patch.name, _patch(robot, patch, surface=off)
        if not hasattr(surface, "modules"):
            own = robot.part(patch.part)
            links = {segment.link for segment in own.segments} - {patch.link}
            for link in sorted(links & set(chain.links)):
                yield "patch on another link", patch.name, _patch(robot, patch, link=link)


def _of_pairs(robot: Robot) -> Iterator[Change]:
    """Yields equal mistakes on the left and right side. A comparison of the two sides can't find them."""
    named = {patch.name: patch for patch in robot.patches}
    for left in robot.patches:
        right = named.get(left.name.replace("left", "right", 1))
        if right is None or right is left or not hasattr(left.surface, "r1"):
            continue
        patches = robot.patches
        for one in (left, right):
            wide = one.surface.model_copy(update={"r1": 2.0 * one.surface.r1, "r2": 2.0 * one.surface.r2})
            patches = _swap(patches, one, one.model_copy(update={"surface": wide}))
        yield "cones twice as wide on both sides", left.name.removeprefix("left_"), {"patches": patches}
        narrow = tuple(_narrowed(one) if one in (left, right) else one for one in robot.patches)
        yield "cones half as wide on both sides", left.name.removeprefix("left_"), {"patches": narrow}
        for way in (0.06, -0.06):
            along = tuple(_pushed(one, way) if one in (left, right) else one for one in robot.patches)
            kind = f"sleeves {1e3 * way:+g} mm along the {left.segment} on both sides"
            yield kind, left.name.removeprefix("left_"), {"patches": along}
    for kind, place, change in (
        ("pascals times 10", "pascal_per_count", _tenfold), ("10 kHz", "frames/s", _hurried),
    ):  # fmt: skip
        yield f"{kind} in all skins", place, {"patches": tuple(map(change, robot.patches))}


def _narrowed(patch: Patch) -> Patch:
    surface = patch.surface
    assert isinstance(surface, TruncatedCone)
    half = surface.model_copy(update={"r1": 0.5 * surface.r1, "r2": 0.5 * surface.r2})
    return patch.model_copy(update={"surface": half})


def _pushed(patch: Patch, way: float) -> Patch:
    surface = patch.surface
    assert isinstance(surface, TruncatedCone)
    origin = np.array(surface.origin) + way * rotation_rpy(*surface.rpy)[:, 2]
    return patch.model_copy(update={"surface": surface.model_copy(update={"origin": tuple(origin.tolist())})})


def _tenfold(patch: Patch) -> Patch:
    factor = 10.0 * patch.sensor.pascal_per_count
    return patch.model_copy(update={"sensor": patch.sensor.model_copy(update={"pascal_per_count": factor})})


def _hurried(patch: Patch) -> Patch:
    return patch.model_copy(update={"rate": 1e4})


def _of_signs(robot: Robot) -> Iterator[Change]:
    for part in robot.parts:
        if part.kind in ("hand", "torso", "head", "leg"):
            for one in part.servos:
                if one.servo is not None and one.transform == "linear":
                    wrong = one.model_copy(update={"scale": -one.scale})
                    yield f"sign of a {part.kind}", f"{part.name} {one.name}", _generic(robot, part, wrong)


def _of_links(robot: Robot) -> Iterator[Change]:
    assert robot.model is not None
    chain = KinematicChain(robot)
    for link in chain.links:
        if chain.chain(link):
            yield (
                "torso link",
                f"torso_link {link}:",
                {"model": robot.model.model_copy(update={"torso_link": link})},
            )


def _of_segments(robot: Robot) -> Iterator[Change]:
    for part in robot.parts:
        for number, segment in enumerate(part.segments):
            for axis in range(3):
                moved = np.array(segment.origin) + 0.2 * np.eye(3)[axis]
                wrong = segment.model_copy(update={"origin": tuple(moved.tolist())})
                segments = (*part.segments[:number], wrong, *part.segments[number + 1 :])
                changed = part.model_copy(update={"segments": segments})
                yield "origin 20 cm off", part.name, {"parts": _swap(robot.parts, part, changed)}


def _of_postures(robot: Robot) -> Iterator[Change]:
    for part in robot.parts:
        if part.side is None:
            for one in part.servos:
                if one.servo is not None:
                    wrong = one.model_copy(update={"initial": float(np.deg2rad(np.deg2rad(20.0)))})
                    kind = "initial angle in radians on head or torso"
                    yield kind, f"{part.name}: initial {one.name}", _generic(robot, part, wrong)
        else:
            for one in part.servos:
                if one.servo is not None and abs(one.initial) > np.deg2rad(10.0):
                    wrong = one.model_copy(update={"initial": float(np.deg2rad(one.initial))})
                    place = f"initial {one.name}"
                    yield "initial angle in radians on one side", place, _generic(robot, part, wrong)


def _servo(robot: Robot, servo: Servo, limits: object) -> dict[str, object]:
    return {"servos": _swap(robot.servos, servo, servo.model_copy(update={"limits": limits}))}


def _patch(robot: Robot, patch: Patch, **changes: object) -> dict[str, object]:
    return {"patches": _swap(robot.patches, patch, patch.model_copy(update=changes))}


def _generic(robot: Robot, part: GenericPart, wrong: object) -> dict[str, object]:
    servos = tuple(wrong if one.id == wrong.id else one for one in part.servos)
    return {"parts": _swap(robot.parts, part, part.model_copy(update={"servos": servos}))}


def _swap(items: tuple[Item, ...], old: Item, new: Item) -> tuple[Item, ...]:
    return tuple(new if item is old else item for item in items)


def main() -> None:
    """Prints a table with one row per kind, and each mistake that was missed or blamed on something else."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["g1", "nao", "icub"])
    parser.add_argument("--count", type=int, default=30)
    options = parser.parse_args()
    for name in options.robots:
        chosen = some(load_robot(name), options.count)
        found = blamed = 0
        for mistake in chosen:
            right, others = judge(mistake)
            found += right
            blamed += bool(others)
            if not right or others:
                print(f"  {'' if right else 'missed '}{mistake.kind}: {mistake.place} {others}")
        kinds = len({mistake.kind for mistake in chosen})
        print(
            f"{name}: {found} of {len(chosen)} mistakes of {kinds} kinds found, {blamed} with other messages"
        )


if __name__ == "__main__":
    main()
