"""Perceptions are plain data, a body is immutable, and only a Perceiver changes."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

import tci
from helpers.touches import body_that
from tci import messages
from tci.body import BodySettings
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.messages import JointReading, Landmark, LimbPlace, Mode, Perception, Reading, SkinFrame
from tci.robot import initial_position
from tci.skin import ContactSettings
from tci.testing import TouchedRobot
from tci.testing.touched_robot import PERIOD

NAO = tci.load_robot("nao-whole")
TOUCHES = (
    None, "left_forearm", "left_forearm", "head_skin", "right_shank", None, "right_forearm", "left_forearm",
    "head_skin", None,
)  # fmt: skip
COPIES: dict[str, Callable[[Any], Any]] = {
    "deep copy": deepcopy,
    "pickle": lambda one: pickle.loads(pickle.dumps(one)),
}
COPIED = pytest.mark.parametrize("copied", COPIES.values(), ids=list(COPIES))


def course() -> tuple[tci.GenericBody, list[Perception]]:
    """Returns a body and a sequence of perceptions of a robot that is touched at several places."""
    robot = TouchedRobot(NAO)
    return robot.body, [robot.perceive(touch, force=4.0) for touch in TOUCHES for _ in range(3)]


def numbers(value: object) -> Iterator[bytes]:
    """Yields the content of a message as bytes."""
    if is_dataclass(value):
        for one in fields(value):
            yield from numbers(getattr(value, one.name))
    elif isinstance(value, Mapping):
        for name in sorted(value):
            yield from numbers((name, value[name]))
    elif isinstance(value, np.ndarray):
        yield value.tobytes()
    elif isinstance(value, str) or not hasattr(value, "__iter__"):
        yield repr(value).encode()
    else:
        for one in value:
            yield from numbers(one)


def callables(value: object, path: str) -> Iterator[str]:
    """Returns the paths of all callable objects in a message."""
    if is_dataclass(value):
        for one in fields(value):
            yield from callables(getattr(value, one.name), f"{path}.{one.name}")
    elif isinstance(value, Mapping):
        for name, one in value.items():
            yield from callables(one, f"{path}[{name!r}]")
    elif isinstance(value, tuple | list) or type(value).__name__.startswith("Contact"):
        for index, one in enumerate(value):
            yield from callables(one, f"{path}[{index}]")
    elif callable(value):
        yield path


def test_no_field_of_a_message_is_callable() -> None:
    found = [one for one in vars(messages).values() if isinstance(one, type) and is_dataclass(one)]
    assert len(found) > 12
    told = [
        f"{one.__name__}.{f.name}: {f.type}"
        for one in found
        for f in fields(one)
        if "Callable" in str(f.type)
    ]
    assert not told
    _, perceptions = course()
    assert not [place for seen in perceptions for place in callables(seen, "perception")]


@COPIED
def test_a_refusal_stands_in_a_copied_memory(copied: Callable[[Any], Any]) -> None:
    """A refused response to a lasting touch is not judged again in each period, even if the memory is stored
    and loaded between periods."""
    body, perceptions = course()
    reflex, looks = tci.WithdrawalReflex(), []

    def retreat(perception: Perception, part: str, target: Any, mode: Mode, *, driven: bool) -> Any:
        looks.append(part)
        return -np.ones((3, 1, len(perception.contacts)))

    counting = body_that("nao-whole", retreat=retreat)
    seen = perceptions[4]
    assert seen.contacts
    memory = reflex.init(body)
    for tick in range(5):
        _, memory = reflex.step(
            copied(memory), replace(copied(seen), stamp=seen.stamp + 1e-3 * tick), counting
        )
    assert memory.refused
    assert len(looks) == 1


@COPIED
def test_a_body_answers_the_same_of_a_copied_perception(copied: Callable[[Any], Any]) -> None:
    body, perceptions = course()
    other = copied(body)
    front, place = Landmark("", (1.0, 0.0, 0.0)), LimbPlace("forearm", 0.5, 0.0)
    asked = 0
    for seen in perceptions:
        twin = copied(seen)
        assert [*numbers(twin)] == [*numbers(seen)]
        target = np.array(seen.posture["left_arm"]) + 0.1
        for contact, same in zip(seen.contacts, twin.contacts, strict=True):
            assert np.array_equal(body.jacobian(seen, contact), other.jacobian(twin, same))
            assert body.distance(contact, front) == other.distance(same, front)
            asked += 1
        assert np.array_equal(
            body.retreat(seen, "left_arm", target, Mode.POSITION),
            other.retreat(twin, "left_arm", target, Mode.POSITION),
        )
        leg = seen.posture["left_leg"]
        assert body.support(seen, "left_leg", leg) == other.support(twin, "left_leg", leg)
        radius = np.array([0.3])
        assert body.coverage(seen, "left_arm", [place], radius) == other.coverage(
            twin, "left_arm", [place], radius
        )
    assert asked > 5


@COPIED
@pytest.mark.parametrize("dtype", [np.uint8, np.float64])
def test_a_copied_perceiver_goes_on_alike(copied: Callable[[Any], Any], dtype: type) -> None:
    """The copy continues with perceptions that are equal bit for bit, and shares no state with the
    original."""
    body, random = tci.GenericBody(NAO), np.random.default_rng(6)
    still = np.zeros(len(NAO.servos))
    position = np.array(initial_position(NAO))

    def reading(k: int) -> Reading:
        frames = []
        for patch in NAO.patches:
            values = patch.sensor.rest + 2.0 * random.standard_normal(patch.channels)
            if k % 40 > 20 and patch.name == "left_forearm":
                values[30:60] -= 60.0
            values = np.clip(np.rint(values), patch.sensor.lowest, patch.sensor.highest).astype(dtype)
            frames.append(SkinFrame(patch.name, k * PERIOD, k, values))
        return Reading(JointReading(k * PERIOD, k, position, still), tuple(frames))

    one = tci.Perceiver(body)
    readings = [reading(k) for k in range(330)]  # longer than the first estimation window
    for k in range(150):
        one.step(readings[k], k * PERIOD)
    other, spoilt = copied(one), one.copy()
    assert spoilt.body is body
    touched = 0
    for k in range(150, 330):
        spoilt.step(replace(readings[k], skin=readings[0].skin), k * PERIOD)
        seen = one.step(readings[k], k * PERIOD)
        assert [*numbers(other.step(readings[k], k * PERIOD))] == [*numbers(seen)], k
        touched += len(seen.contacts)
    assert touched
    assert other.health == one.health
    assert other.counts == one.counts


def test_a_body_does_not_change() -> None:
    body = tci.GenericBody(NAO)
    for name in ("robot", "settings", "joint_maps"):
        with pytest.raises(FrozenInstanceError):
            setattr(body, name, None)
    assert deepcopy(body) is body
    assert pickle.loads(pickle.dumps(body)).robot == body.robot
    settings = BodySettings(contacts=ContactSettings(touch=0.5))
    assert pickle.loads(pickle.dumps(tci.GenericBody(NAO, settings))).settings == settings


def test_the_kind_of_a_part_is_what_its_description_says() -> None:
    """The kind of a part depends only on its description, not on its name or its number of joints."""
    names = {"left_arm": "port", "head": "left_arm_2", "left_leg": "some_arm"}
    parts = tuple(part.model_copy(update={"name": names.get(part.name, part.name)}) for part in NAO.parts)
    patches = tuple(p.model_copy(update={"part": names.get(p.part, p.part)}) for p in NAO.patches)
    robot = NAO.model_copy(update={"parts": parts, "patches": patches, "digest": "renamed"})
    body = tci.GenericBody(robot)
    assert body.parts("arm") == ("port", "right_arm")
    assert body.parts("head") == ("left_arm_2",)
    assert body.parts("leg") == ("some_arm", "right_leg")
    for capability, touch, moved in (
        (tci.WithdrawalReflex(), "left_forearm", "port"),
        (BodyWithdrawal(), "head_skin", "left_arm_2"),
        (BodyWithdrawal(stance="supported"), "left_shank", "some_arm"),
    ):
        touched = TouchedRobot(robot)
        seen = touched.perceive(touch, force=5.0)
        commands, _ = capability.step(capability.init(touched.body), seen, touched.body)
        assert [command.part for command in commands] == [moved], touch


def test_what_has_five_joints_is_no_arm() -> None:
    """The reflex requests no control mode for a part that only has as many joints as an arm."""
    tail = NAO.part("left_leg").model_copy(update={"kind": "other"})
    five = tail.model_copy(update={"servos": tail.servos[:5]})
    parts = tuple(five if part.name == "left_leg" else part for part in NAO.parts)
    robot = NAO.model_copy(update={"parts": parts, "digest": "tail"})
    touched = TouchedRobot(robot)
    begun = tci.WithdrawalReflex(mode=Mode.VELOCITY).begin(touched.perceive(), touched.body)
    assert [order.part for order in begun] == ["left_arm", "right_arm"]
