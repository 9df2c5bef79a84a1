"""The predictions of `tci safety` against the judge's own plant, and what its report says."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from helpers.command_line import tci
from helpers.rigid_robot import CLEAN, ROBOT, STEP, Person, RigidDriver, RigidRobot
from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.errors import DescriptionError
from tci.gate.settings import GateSettings
from tci.lab.experiments.impacts import LASTING, Impact, Impacts
from tci.lab.experiments.safety_report import Limits
from tci.messages import Mode, Order, Perception, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array
from tci.robot.blow import PEOPLE, REACTION, Striker, Struck
from tci.robot.catalogue import load_robot
from tci.runtime.loop import run
from tci.runtime.moment import Tick

RADIUS = {"chest": 0.12, "abdomen": 0.12, "back": 0.12, "upper arm": 0.05, "lower arm": 0.04, "hand": 0.02}
"""[m], half of how thick an adult is there: off a ball of 2 cm links slide that sink into a belly."""
DAMPING = 0.05
"""Ratio of the surface on its spring: limits are for springs, and the judge's usual 0.3 takes 5 to 10 %."""
GAP = 1e-4
SERVO = replace(CLEAN, frequency=(100.0, 100.0))
GATED = replace(SERVO, delay=(0.005, 0.005), late=(1, 1))
LAG = 0.05
"""Time [s] after which links have the speed of their references."""


def alone(plant: RigidRobot, link: str) -> None:
    """Lets people pass through all other links: a neighbour may touch first."""
    model = plant.model
    others = (model.geom_bodyid != model.body(link).id) & (model.geom_contype == ROBOT)
    model.geom_contype[others] = model.geom_conaffinity[others] = 0


def strike(name: str, impact: Impact, *, servos: bool) -> float:
    """Largest force [N] on the person in the judge's plant."""
    person, radius = impact.person, RADIUS[impact.person.name]
    hit = Person(
        "hit", person.stiffness, None if impact.clamped else person.mass, radius=radius, damping=DAMPING
    )
    plant = RigidRobot(load_robot(name), dirt=SERVO, angles=impact.position, people=[hit])
    model = plant.model
    alone(plant, impact.link)
    place, rotation = plant.link_pose(impact.link)
    plant.place("hit", place + rotation @ impact.point + (radius + GAP) * impact.direction)
    rate = impact.velocity[plant._servo] * plant._ratio
    brakes = np.array([plant.robot.servos[servo].limits.acceleration or 20.0 for servo in plant._servo])
    plant.data.qvel[plant._dof] = rate
    plant._target = plant._reference + rate
    if not servos:
        model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    mujoco.mj_forward(model, plant.data)
    while plant.time < LASTING:
        slower = brakes * np.abs(plant._ratio) * max(plant.time - REACTION, 0.0)
        plant._stride = np.maximum(np.abs(rate) - slower, 0.0) * STEP
        plant.advance(plant.time + STEP)
    return plant.felt["hit"].peak


@dataclass(frozen=True)
class Rush(Capability[None]):
    """Brings servos to the speeds of an impact where it begins, each as late as it can."""

    servos: Array
    rates: Array
    accelerations: Array

    @property
    def lasts(self) -> float:
        return float((np.abs(self.rates) / self.accelerations).max())

    def init(self, body: GenericBody) -> None:
        pass

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return (PlatformSwitch(self.servos, Mode.VELOCITY),)

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        slower = self.accelerations * max(self.lasts - perception.stamp, 0.0)
        goes = np.sign(self.rates) * np.maximum(np.abs(self.rates) - slower, 0.0)
        return (PlatformCommand(Mode.VELOCITY, self.servos, goes, np.full(len(goes), 100.0)),), None


def rush(name: str, impact: Impact, settings: GateSettings | None = None) -> tuple[float, float]:
    """Largest force [N] on the person if the gate moves the robot, and the share of the impact's speed."""
    robot, person = load_robot(name), impact.person
    servos = np.flatnonzero(impact.velocity)
    limits = [robot.servos[servo].limits for servo in servos]
    accelerations = 0.9 * np.array([one.acceleration for one in limits], dtype=float)
    rates, angles = 0.97 * impact.velocity[servos], impact.position.copy()
    angles[servos] -= rates * np.abs(rates) / (2.0 * accelerations)
    mass, radius = None if impact.clamped else person.mass, RADIUS[person.name]
    hit = Person("hit", person.stiffness, mass, radius=radius, damping=DAMPING)
    plant = RigidRobot(robot, dirt=GATED, angles=angles, people=[hit])
    alone(plant, impact.link)
    motion, goes = Rush(servos, rates, accelerations), list[float]()

    def see(_: Tick) -> None:
        if plant.time < motion.lasts + LAG or goes:
            return
        place, rotation = plant.link_pose(impact.link)
        ahead, arm = impact.direction, rotation @ impact.point
        plant.place("hit", place + arm + (radius + GAP) * ahead)
        speeds = np.zeros(6)
        body = plant.model.body(impact.link).id
        mujoco.mj_objectVelocity(plant.model, plant.data, mujoco.mjtObj.mjOBJ_XBODY, body, speeds, 0)
        goes.append(float((speeds[3:] + np.cross(speeds[:3], arm)) @ ahead))

    run(RigidDriver(plant, settings=settings), motion, duration=motion.lasts + 0.6, observe=see)
    return plant.felt["hit"].peak, goes[0] / impact.speed


@pytest.mark.parametrize("name", ["nao", "icub", "g1", "talos", "alex"])
def test_blows_are_predicted_as_a_coupled_robot_strikes(name: str) -> None:
    impacts = [*Impacts(load_robot(name)).draw(24, PEOPLE, seed=11)]
    with_servos = np.array([strike(name, one, servos=True) / one.answered for one in impacts]) - 1.0
    assert np.median(np.abs(with_servos)) <= 0.10
    assert np.mean(np.abs(with_servos) <= 0.25) >= 0.75
    free = [one for one in impacts if not one.clamped]
    coasting = [
        strike(name, one, servos=False)
        / Striker(one.striker.mass, 0.0, 0.0, 0.0).force_on(one.person, one.speed)
        for one in free
    ]
    assert np.median(np.abs(np.array(coasting) - 1.0)) <= 0.10


@pytest.mark.parametrize("number", [490, 501, 983])
def test_nobody_is_struck_harder_since_a_contact_is_noticed(number: int) -> None:
    """Nor is it predicted. A reference that stood at once would tear a NAO's shoulder off the person, which
    the joints that lag then throw back there: 1.2, 1.4 and 1.1 times as hard."""
    *_, impact = Impacts(load_robot("nao")).draw(number + 1, PEOPLE)
    assert impact.answered <= 1.05 * impact.unanswered
    (noticed, share), (blind, _) = (rush("nao", impact, x) for x in (None, GateSettings(contact=None)))
    assert share > 0.7
    assert noticed <= 1.01 * blind


def test_joints_are_as_fast_as_they_get_between_their_limits() -> None:
    """A G1's may go at 37 rad/s, but accelerate with 35 rad/s2 over a few radians."""
    robot = load_robot("g1")
    limits = [one.limits for one in robot.servos]
    lower, upper, most = (
        np.array([getattr(one, name) for one in limits]) for name in ("lower", "upper", "acceleration")
    )
    for one in Impacts(robot).draw(20, PEOPLE, seed=1):
        way = one.velocity**2 / (2.0 * most)
        assert (one.position - way >= lower - 1e-9).all()
        assert (one.position + way <= upper + 1e-9).all()


def test_equal_seeds_draw_equal_impacts() -> None:
    impacts = Impacts(load_robot("nao"))
    one, other = ([each.answered for each in impacts.draw(5, PEOPLE, seed=3)] for _ in range(2))
    assert one == other


def test_the_report_says_what_it_is_and_what_a_user_limits(tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("region,stiffness_N_mm,mass_kg,force_N,pressure_N_cm2\nhand,75,0.6,10,20\n")
    report = json.loads(tci("safety", "nao", "--impacts", "20", "--limits", str(file), "--json"))
    assert report["notice"].startswith("A prediction, no certificate. Adults only")
    assert {row["region"] for row in report["rows"]} == {"hand"}
    assert {row["limit_N"] for row in report["rows"]} == {20.0}
    assert {row["pressure_limit_N_cm2"] for row in report["rows"]} == {40.0}
    assert len(report["rows"][0]["worst"]["angles_deg"]) == len(load_robot("nao").servos)
    margins = [row["margin"] for row in report["rows"]]
    assert margins == sorted(margins)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("region,force_N\nhand,3\n", "no column stiffness_N_mm, mass_kg"),
        (
            "region,stiffness_N_mm,mass_kg,force_N\nhand,75,0.6,many\n",
            "line 2: force_N 'many'; valid: a number above 0",
        ),
        (
            "region,stiffness_N_mm,mass_kg,force_N\nhand,75,0.6,9\nhand,75,0.6,8\n",
            "line 3: region 'hand' again; valid: each region once",
        ),
        ("region,stiffness_N_mm,mass_kg,force_N\n", "no region"),
        ("\xff", "no column region"),
    ],
)
def test_a_wrong_file_of_limits_names_the_place(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text(text, encoding="latin-1")
    with pytest.raises(DescriptionError, match=words):
        Limits.read(file)
    assert isinstance(PEOPLE[0], Struck)
