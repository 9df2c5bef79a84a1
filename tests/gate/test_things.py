"""An arm that meets a table or the robot itself stops; whoever may be between them is freed."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from helpers.gate_checks import make_robot, position_command, reading
from helpers.rigid_robot import Person, RigidRobot
from helpers.squeezed import links_of
from tci.errors import DescriptionError, TciError
from tci.gate.contact.felt import FeltContact
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.things import Things
from tci.gate.gate import Gate, GateSettings, GateState
from tci.messages import Contacts
from tci.messages.contacts import CONTACT, TAXEL, Site
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.clearance import Clearance, Fixture
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain

NAO = load_robot("nao")
PITCH = next(servo.index for servo in NAO.servos if servo.name == "LShoulderPitch")
PERIOD = 0.01


class Lowered:
    """A NAO that lowers its left arm until something below stops it."""

    def __init__(self, *fixtures: Fixture, start: float = 20.0, at: float = 50.0) -> None:
        settings = GateSettings(contact=ContactSettings(fixtures=fixtures))
        self.gate = Gate(NAO, period=PERIOD, stale_after=0.1, settings=settings, streams=True)
        self.angles, self.at, self.now = np.array(initial_position(NAO)), np.deg2rad(at), 0.0
        self.angles[PITCH] = np.deg2rad(start)
        self.told: list[str] = []
        self.refused: list[Code] = []
        self.answers: set[str] = set()

    def run(self, lasts: float, goal: float | None = None, contacts: Contacts | None = None) -> float:
        """Returns the arm's reference [rad] in the end."""
        orders = [] if goal is None else [position_command([PITCH], [np.deg2rad(goal)])]
        for _ in range(round(lasts / PERIOD)):
            safe = self.gate.step(orders, reading(self.angles, self.now), self.now, contacts=contacts)
            orders = []
            self.angles[safe.servos] = safe.position
            self.angles[PITCH] = min(self.angles[PITCH], self.at)
            self.answers = {one.answer for one in safe.met}
            self.told += [one.text for one in safe.clamped if one.code is Code.CONTACT]
            self.refused += [one.code for one in safe.refusals]
            self.now += PERIOD
        return float(safe.position[safe.servos.tolist().index(PITCH)])


def lowest(degrees: float) -> float:
    """Height [m] of the arm's lowest point above the model's root, by the judge's plant."""
    angles = np.array(initial_position(NAO))
    angles[PITCH] = np.deg2rad(degrees)
    plant = RigidRobot(NAO, angles=angles, people=[Person("below", 1e4)])  # 50 m below the robot
    model, links = plant.model, links_of(NAO, plant, "left_arm")
    below, segment = model.geom("below").id, np.empty(6)
    ways = [
        mujoco.mj_geomDistance(model, plant.data, geom, below, 100.0, segment)
        for geom in range(model.ngeom)
        if model.body(model.geom_bodyid[geom]).name in links
    ]
    bottom = min(ways) + float(plant.data.geom_xpos[below, 2]) + float(model.geom_size[below, 0])
    return bottom - float(plant.data.body("Torso").xpos[2])


@pytest.mark.parametrize("between", [0.0, 0.015])
def test_an_arm_that_meets_a_declared_table_stops_but_not_if_somebody_may_lie_on_it(between: float) -> None:
    """15 mm are a thin hand. Without the table's name, nobody knows that nobody is to be freed."""
    top = lowest(50.0) - between
    arm = Lowered(Fixture("table", (0.1, 0.2, top - 0.1), (0.5, 0.5, 0.2)))
    rests = arm.run(1.5, goal=80.0)
    assert ("left_arm met the fixture table: LShoulderPitch is held" in arm.told[0]) is not bool(between)
    assert arm.gate.state is GateState.RUN
    if between:
        assert arm.told[0].endswith("it goes back softly")
        assert rests < arm.at - np.deg2rad(2.5)
        return
    assert arm.told[0].endswith("it stops")
    assert rests == pytest.approx(arm.at, abs=np.deg2rad(0.5)), "nothing presses, and nothing is given up"
    arm.run(1.0, goal=20.0)
    assert arm.angles[PITCH] < np.deg2rad(25.0), "a command may lead away half a second later"


def touch(patch: str, p_T: Array, n_T: Array, *, force: float = 20.0) -> Contacts:
    rows = np.zeros(1, CONTACT)
    rows["identity"], rows["force"], rows["p_T"], rows["n_T"] = 7, force, p_T, n_T
    return Contacts(
        (Site(patch, "left_arm", "forearm"),), np.zeros(1), np.zeros(1, np.int64), rows,
        np.zeros(2, np.int64), np.zeros(0, TAXEL),
    )  # fmt: skip


def beside_its_leg() -> tuple[Lowered, Callable[[float], Contacts]]:
    """An arm near its own leg, and what its skin feels there: the leg (1), or somebody on the other side of
    the same link (-1)."""
    arm, clearance = Lowered(at=180.0), Clearance(NAO)
    roll = next(servo.index for servo in NAO.servos if servo.name == "LShoulderRoll")
    arm.angles[PITCH] = np.deg2rad(85.0)
    touching = []
    for degrees in np.arange(25.0, -18.0, -0.5):
        arm.angles[roll] = np.deg2rad(degrees)
        if touching := clearance.near(arm.angles, within=0.006):
            break
    pair = touching[0]
    sign = 1.0 if PITCH in KinematicChain(NAO).chain(pair.first) else -1.0
    arm.angles[PITCH] = np.deg2rad(82.0)
    arm.run(0.25, goal=85.5)
    return arm, lambda side: touch("left_forearm", pair.p_T, side * sign * pair.way_T)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_an_arm_feels_where_it_touches_its_own_leg_is_nobody(side: float) -> None:
    """A contact on the other side of the same link is somebody all the same."""
    arm, contact = beside_its_leg()
    arm.run(0.5, goal=86.5, contacts=contact(side))
    assert ("met its own" in arm.told[0]) is (side > 0.0)
    assert arm.told[0].endswith("it stops" if side > 0.0 else "it goes back softly")
    stopped = arm.angles[PITCH]
    arm.gate.free()
    arm.run(1.0, contacts=contact(side))
    assert side < 0.0 or arm.angles[PITCH] < stopped - np.deg2rad(1.0), "an operator's word counts more"


def test_who_comes_while_an_arm_touches_its_own_leg_is_somebody() -> None:
    arm, contact = beside_its_leg()
    arm.run(0.5, goal=86.5, contacts=contact(1.0))
    assert arm.answers == {"stop"}
    stopped = arm.angles[PITCH]
    arm.run(0.5, contacts=contact(-1.0))
    assert arm.answers == {"retreat"}
    assert arm.angles[PITCH] < stopped - np.deg2rad(1.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_only_the_other_link_feels_may_be_somebody(side: float) -> None:
    """Skin of the trunk feels the arm where the two meet, or somebody on another side."""
    arm, _ = beside_its_leg()
    (pair, *_), moved = Clearance(NAO).near(arm.angles, within=0.006), KinematicChain(NAO)
    servos = np.array([servo for joint in NAO.part("left_arm").servos if (servo := joint.servo) is not None])
    arm_first = PITCH in moved.chain(pair.first)
    thing, way = (pair.second, -pair.way_T) if arm_first else (pair.first, pair.way_T)
    ahead = arm.angles.copy()
    ahead[next(servo.index for servo in NAO.servos if servo.name == "LShoulderRoll")] -= np.deg2rad(8.0)
    felt = FeltContact(20.0, side * way, pair.p_T)
    met = [Things(NAO, ()).met(servos, arm.angles, ahead, [], on) for on in ({}, {thing: [felt]})]
    assert met[0] is not None
    assert met[1] == (met[0] if side > 0.0 else None)


@pytest.mark.parametrize("weight", [8.0, 20.0])
def test_an_arm_that_lies_on_a_table_obeys_again_and_stops_again_if_it_presses_more(weight: float) -> None:
    """Skin feels its weight for as long as it lies there. It waited for an operator's word."""
    table = Fixture("table", (0.1, 0.2, lowest(50.0) - 0.1), (0.5, 0.5, 0.2))
    arm = Lowered(table, at=60.0)
    arm.run(0.6, goal=49.5)
    near = min(Clearance(NAO, (table,)).near(arm.angles, within=0.008), key=lambda one: one.distance)
    side = 1.0 if PITCH in KinematicChain(NAO).chain(near.first) else -1.0

    def lies(force: float) -> Contacts:
        return touch("left_forearm", near.p_T, side * near.way_T, force=force)

    arm.run(0.05, goal=51.0)
    arm.run(0.1, contacts=lies(30.0))
    assert arm.told[-1].endswith("it stops")
    arm.run(0.4, contacts=lies(weight))
    arm.run(0.01, goal=20.0, contacts=lies(weight))
    assert arm.refused.pop() is Code.CONTACT, "it has just met it"
    arm.run(0.8, contacts=lies(weight))
    lay, told = arm.angles[PITCH], len(arm.told)
    arm.run(0.05, goal=51.5, contacts=lies(weight))
    arm.run(0.1, contacts=lies(weight + 12.0))
    assert len(arm.told) == told + 1
    assert arm.angles[PITCH] < lay + np.deg2rad(1.0)
    arm.run(1.2, contacts=lies(weight))
    arm.run(0.5, goal=20.0, contacts=lies(weight))
    assert not arm.refused
    assert arm.angles[PITCH] < np.deg2rad(40.0)
    assert arm.gate.state is GateState.RUN


def test_a_table_that_an_arm_meets_often_is_no_reason_to_stop_the_robot() -> None:
    arm = Lowered(Fixture("table", (0.1, 0.2, lowest(50.0) - 0.1), (0.5, 0.5, 0.2)))
    for _ in range(4):
        arm.run(1.5, goal=80.0)
        arm.run(1.0, goal=20.0)
    assert len(arm.told) >= 4
    assert arm.gate.state is GateState.RUN


def test_a_fixture_that_can_not_be_is_refused_and_none_is_left_out_in_silence() -> None:
    with pytest.raises(
        TciError, match=r"fixture table: .*valid: 3 finite numbers each, and lengths above 0 m"
    ):
        Fixture("table", (0.0, 0.0, -1.0), (1.0, 1.0, 0.0))
    with pytest.raises(TciError, match=r"fixture table: .*valid: 3 finite numbers each"):
        Fixture("table", (0.0, 0.0), (1.0, 1.0, 1.0))  # type: ignore[arg-type]
    twice = (Fixture("table", (0.0, 0.0, -1.0), (1.0, 1.0, 1.0)),) * 2
    with pytest.raises(TciError, match="fixtures table, table; valid: another name for each"):
        Lowered(*twice)
    settings = GateSettings(contact=ContactSettings(fixtures=twice[:1]))
    with pytest.raises(DescriptionError, match="model"):
        Gate(make_robot(), period=PERIOD, stale_after=0.1, settings=settings)
