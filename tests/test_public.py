"""What is public holds together: types in signatures are public, and a robot may be its name."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import tci
from helpers.public_names import public_objects
from tci.errors import TciError
from tci.messages import ModeLike
from tci.messages.frames import Array
from tci.robot import RobotLike

PUBLIC = public_objects()
IDS = {id(thing) for thing in PUBLIC.values()}
BY_NAME = {name.rpartition(".")[2]: thing for name, thing in PUBLIC.items()} | {"EnvSpec": object}
"""For annotations of modules that import a type for type checkers only; Gymnasium does it with EnvSpec."""
INNER = {"Hands", "LayoutArrays", "Limits", "Physics", "PosedSkin"}
"""Tables of compiled loops and of the simulation, which only TCI makes and reads."""
MEMORIES = {
    "Attention",
    "FingerMemory",
    "GentleMemory",
    "GestureMemory",
    "Grip",
    "Heard",
    "LetGo",
    "PolicyMemory",
    "Posture",
    "StopMemory",
    "Taught",
    "Withdrawals",
}
"""Memories of capabilities: programs hand them back and read nothing in them."""


def own(kind: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    """The public methods and properties of a class, and its constructor, as far as TCI defines them."""
    for name in dir(kind):
        member = inspect.getattr_static(kind, name)
        if isinstance(member, property):
            member = member.fget
        elif isinstance(member, cached_property):
            member = member.func
        member = getattr(member, "__func__", member)
        shown = name == "__init__" or not name.startswith("_")
        if shown and inspect.isfunction(member) and member.__module__.startswith("tci"):
            yield name, member


def calls() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function, method and constructor, each once."""
    for address, thing in {id(one): (name, one) for name, one in PUBLIC.items()}.values():
        if inspect.isclass(thing) and thing.__name__ not in MEMORIES:
            yield from ((f"{address}.{name}", member) for name, member in own(thing))
        elif inspect.isroutine(thing) or hasattr(thing, "__wrapped__"):
            yield address, thing


CALLS = dict(calls())


def hints(thing: Any) -> dict[str, Any]:
    return get_type_hints(inspect.unwrap(thing), None, BY_NAME)


def parts(annotation: Any) -> Iterator[Any]:
    """All classes that an annotation names."""
    if get_origin(annotation) is Literal:
        return
    if isinstance(annotation, list | tuple):
        for inner in annotation:
            yield from parts(inner)
    elif get_origin(annotation) is not None:
        yield get_origin(annotation)
        yield from parts(get_args(annotation))
    else:
        yield annotation


def strangers(named: dict[str, Any]) -> set[str]:
    """The classes of TCI among the annotations that users can't import."""
    shown = [one for name, given in named.items() if not name.startswith("_") for one in parts(given)]
    ours = [one for one in shown if isinstance(one, type) and one.__module__.split(".")[0] == "tci"]
    return {one.__name__ for one in ours if id(one) not in IDS} - INNER


def test_types_in_public_signatures_are_public() -> None:
    assert len(CALLS) > 200
    found = {name: strangers(hints(call)) for name, call in CALLS.items()}
    assert not {name: kinds for name, kinds in found.items() if kinds}


def test_types_of_public_attributes_are_public() -> None:
    classes = {name: thing for name, thing in PUBLIC.items() if inspect.isclass(thing)}
    found = {name: strangers(hints(kind)) for name, kind in classes.items() if kind.__name__ not in MEMORIES}
    assert not {name: kinds for name, kinds in found.items() if kinds}


MADE_BY_TCI = {"BatchScene", "DataSet", "Reach", "JointMap", "DriverInfo", "RunResult"}
"""Records whose constructors TCI calls."""
CALLED_BY_TCI = "probe"
"""A driver's method: TCI calls it with the robot that it has loaded."""
NAO = tci.load_robot("nao")
ROBOTS: dict[str, Callable[[Any, Path], Any]] = {
    "connect": lambda robot, _: tci.connect(robot).read().joints.position,
    "SimulatedDriver": lambda robot, _: BY_NAME["SimulatedDriver"](robot).read().joints.position,
    "FakeDriver": lambda robot, _: BY_NAME["FakeDriver"](robot).position,
    "ReplayDriver": lambda robot, path: BY_NAME["ReplayDriver"](robot, recorded(path)).robot.name,
    "of": lambda robot, _: (
        BY_NAME["DriverInfo"].of(robot, "sim", clock=BY_NAME["ManualClock"](), armed=False).robot.name
    ),
    "GenericBody": lambda robot, _: repr(tci.GenericBody(robot)),
    "World": lambda robot, _: tci.World(robot).joints().position,
    "Recorder": lambda robot, path: tci.Recording(recorded(path, robot)).about["description"],
    "tables": lambda robot, path: sorted(BY_NAME["tables"](tci.Recording(recorded(path)), robot)),
    "read_set": lambda robot, path: BY_NAME["read_set"]([recorded(path, periods=1)], robot=robot).robot.name,
    "recorded_robot": lambda robot, path: (
        BY_NAME["recorded_robot"](tci.Recording(recorded(path)), robot).name
    ),
    "film": lambda robot, path: tci.film(
        recorded(path, robot, periods=1), path.with_name(f"{time.monotonic_ns()}.png"), robot=robot
    ),
    "Gate": lambda robot, _: BY_NAME["Gate"](robot, period=0.002, stale_after=0.1).robot.name,
    "fit": lambda robot, _: BY_NAME["fit"](
        robot, BY_NAME["Gesture"]([0.0, 1.0], {"head": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]})
    ).gesture.postures["head"],
    "query": lambda robot, _: BY_NAME["query"](robot).model_dump_json(),
    "to_urdf": lambda robot, _: BY_NAME["to_urdf"](robot),
    "skin_to_urdf": lambda robot, _: BY_NAME["skin_to_urdf"](robot),
    "skin_to_mjcf": lambda robot, _: BY_NAME["skin_to_mjcf"](robot),
    "skin_to_json": lambda robot, _: BY_NAME["skin_to_json"](robot),
    "initial_position": lambda robot, _: BY_NAME["initial_position"](robot),
    "KinematicChain": lambda robot, _: BY_NAME["KinematicChain"](robot).links,
    "Gravity": lambda robot, _: BY_NAME["Gravity"](robot).masses,
    "InverseKinematics": lambda robot, _: (
        BY_NAME["InverseKinematics"](robot, BY_NAME["KinematicChain"](NAO), "LHand").servos
    ),
    "check": lambda robot, _: BY_NAME["JointCalibration"](robot="nao").check(robot),
    "values": lambda robot, _: BY_NAME["JointCalibration"](robot="nao").values(robot, "rotor"),
    "Skin": lambda robot, _: sorted(BY_NAME["Skin"](robot).surfaces),
    "of_robot": lambda robot, _: BY_NAME["SkinLayout"].of_robot(robot).places,
    "TouchedRobot": lambda robot, _: BY_NAME["TouchedRobot"](robot).perceive().stamp,
    "perception": lambda robot, _: BY_NAME["perception"](robot).stamp,
    "lacks": lambda robot, _: tci.capabilities.lacks(tci.WithdrawalReflex(), robot),
    "met": lambda robot, _: tci.capabilities.Need("skin").met(robot),
    "skin_of": lambda robot, _: [one.name for one in tci.capabilities.Need("skin").skin_of(robot)],
    "TouchEnv": lambda robot, _: BY_NAME["TouchEnv"](robot).policy,
    "NamedEnv": lambda robot, _: BY_NAME["NamedEnv"](robot).observed,
    "NamedRobot": lambda robot, _: BY_NAME["NamedRobot"](robot).observed,
    "TouchVectorEnv": lambda robot, _: BY_NAME["TouchVectorEnv"](robot, 1, threads=1).policy,
    "batch_scene": lambda robot, _: BY_NAME["batch_scene"](robot).taxels,
    "make_worlds": lambda robot, _: BY_NAME["make_worlds"](robot, 1).joints,
    "simulate": lambda robot, _: BY_NAME["simulate"](robot, duration=0.01, cores=1)[0].world,
}
"""A short use of each public call that takes a robot, by the last part of its name."""


def recorded(path: Path, robot: RobotLike = NAO, *, periods: int = 0) -> str:
    """Path of a recording with some periods."""
    path.unlink(missing_ok=True)
    with tci.Recorder(path, robot) as recorder, tci.connect(robot) as driver:
        for _ in range(periods):
            reading = driver.read()
            recorder.tick(reading.joints.stamp, reading)
        return str(path)


def takers() -> dict[str, str]:
    """The public calls with a parameter `robot`, each with the last part of its name."""
    found = {}
    for name, call in CALLS.items():
        short = name.removesuffix(".__init__").rpartition(".")[2]
        made = name.endswith("__init__") and short in MADE_BY_TCI
        if "robot" in inspect.signature(call).parameters and short != CALLED_BY_TCI and not made:
            found[name] = short
    return found


def test_every_public_call_that_takes_a_robot_is_tried() -> None:
    assert set(takers().values()) == set(ROBOTS)


@pytest.mark.parametrize("name", takers())
def test_a_robot_may_be_its_name_or_its_path(name: str, tmp_path: Path) -> None:
    assert hints(CALLS[name])["robot"] in (RobotLike, RobotLike | None)
    use = ROBOTS[takers()[name]]
    expected = use(NAO, tmp_path / "one.mcap")
    for given in ("nao", Path(NAO.source)):
        np.testing.assert_equal(use(given, tmp_path / "one.mcap"), expected)
    with pytest.raises(TciError, match="in place of a robot; valid"):
        use(tci.Robot, tmp_path / "one.mcap")


MESSAGES = ("SwitchMode", "GenericCommand", "PlatformSwitch", "PlatformCommand")
"""Messages state the fields that they keep. What they take is for type checkers (tools/user_types.py)."""
INNER_LOOPS = ("tci.skin.", "tci.robot.JointMap.", "tci.robot.Sensor.")
"""These get arrays and convert nothing."""


def test_a_mode_may_be_its_name_and_an_array_a_list() -> None:
    strict = {}
    for name, call in CALLS.items():
        taken = {one: given for one, given in hints(call).items() if one != "return"}
        if name.endswith("__init__"):  # the arrays of records come from TCI
            taken = {one: given for one, given in taken.items() if given != Array}
        if name.split(".")[-2] not in MESSAGES and not name.startswith(INNER_LOOPS):
            strict[name] = [one for one, given in taken.items() if given in (Array, tci.Mode)]
    assert not {name: taken for name, taken in strict.items() if taken}
    assert tci.Mode in get_args(ModeLike)


def test_lists_and_names_work_as_commands() -> None:
    command = tci.GenericCommand("left_arm", "position", [0] * 5)
    assert command.mode is tci.Mode.POSITION
    assert command.values.dtype == np.float64
    assert tci.SwitchMode("left_arm", "velocity").mode is tci.Mode.VELOCITY
    assert tci.CartesianCommand("left_arm", [0.5, 0.1, -0.5]).target.shape == (3,)
    with pytest.raises(tci.CommandError, match="target of left_arm"):
        tci.CartesianCommand("left_arm", ["a", "b", "c"])


def test_reprs_are_one_line_that_says_what_it_is() -> None:
    with tci.connect("nao") as driver:
        assert repr(driver) == "SimulatedDriver('nao' by sim, armed, 500 Hz)"
    assert repr(driver) == "SimulatedDriver('nao' by sim, closed, 500 Hz)"
    robot = tci.load_robot("g1-bare")
    assert repr(robot).startswith("Robot('g1-bare': 29 servos; left_arm, right_arm, head")
    assert repr(robot).endswith("skin on nothing)")
    assert repr(tci.GenericBody("nao")).endswith("; 729 taxels)")
    for one in (driver, robot, tci.GenericBody("nao")):
        assert len(repr(one)) < 300
        assert "\n" not in repr(one)
        assert str(one) == repr(one)
