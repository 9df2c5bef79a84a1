"""The predictions of `tci safety` against the judge's own plant, and what its report says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from helpers.command_line import tci
from helpers.rigid_robot import CLEAN, ROBOT, STEP, Person, RigidRobot
from tci.errors import DescriptionError
from tci.lab.experiments.impacts import LASTING, Impact, Impacts
from tci.lab.experiments.safety_report import Limits
from tci.robot.blow import PEOPLE, REACTION, Striker, Struck
from tci.robot.catalogue import load_robot

RADIUS = {"chest": 0.12, "abdomen": 0.12, "back": 0.12, "upper arm": 0.05, "lower arm": 0.04, "hand": 0.02}
"""[m], half of how thick an adult is there: off a ball of 2 cm links slide that sink into a belly."""
DAMPING = 0.05
"""Ratio of the surface on its spring: limits are for springs, and the judge's usual 0.3 takes 5 to 10 %."""
GAP = 1e-4
SERVO = replace(CLEAN, frequency=(100.0, 100.0))


def strike(name: str, impact: Impact, *, servos: bool) -> float:
    """Largest force [N] on the person in the judge's plant."""
    person, radius = impact.person, RADIUS[impact.person.name]
    hit = Person(
        "hit", person.stiffness, None if impact.clamped else person.mass, radius=radius, damping=DAMPING
    )
    plant = RigidRobot(load_robot(name), dirt=SERVO, angles=impact.position, people=[hit])
    model = plant.model
    others = (model.geom_bodyid != model.body(impact.link).id) & (model.geom_contype == ROBOT)
    model.geom_contype[others] = model.geom_conaffinity[others] = 0  # a neighbour may touch first
    place, rotation = plant.link_pose(impact.link)
    plant.place("hit", place + rotation @ impact.point + (radius + GAP) * impact.direction)
    rate = impact.velocity[plant._servo] * plant._ratio
    plant.data.qvel[plant._dof] = rate
    plant._target, plant._stride = plant._reference + rate * REACTION, rate * STEP
    if not servos:
        model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    mujoco.mj_forward(model, plant.data)
    plant.advance(LASTING)
    return plant.felt["hit"].peak


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
