"""A gesture is recorded on one robot, played on another robot, and interrupted by the reflex."""

from __future__ import annotations

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.places import find_place
from tci.capabilities.fields import default_fields
from tci.capabilities.play_gesture import Phase, PlayGesture
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.gestures.gesture import Gesture, fit, record
from tci.lab.experiments.follow import follow
from tci.lab.experiments.verdict import arm_axes
from tci.messages import Perception
from tci.messages.frames import Array, angle_between
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.runtime.loop import Tick
from tci.simulation.world import World
from tci.skin.skin import Skin

ARMS = ("left_arm", "right_arm")


def wave() -> Gesture:
    """Returns a gesture in which both arms wave."""
    t = np.linspace(0.0, 4.0, 81)
    columns = (
        40 + 25 * np.sin(t),
        30 + 10 * np.sin(1.5 * t),
        10 * np.sin(t),
        55 + 20 * np.sin(2 * t),
        25 * np.sin(3 * t),
    )
    angles = np.deg2rad(np.column_stack(columns))
    return Gesture(t, {"left_arm": angles, "right_arm": angles[::-1]})


def limbs(robot: Robot, kinematics: KinematicChain, position: Array) -> list[Array]:
    """Returns the axes (3,) of both upper arms and forearms in the torso frame, from the kinematic model."""
    found = []
    for name in ARMS:
        part = robot.part(name)
        mapped = {joint.servo for joint in part.servos}
        hand = next(link for link in kinematics.links if mapped <= set(kinematics.chain(link)))
        upper_arm, _, forearm = arm_axes(robot, part, kinematics, hand, position)
        assert forearm is not None
        found += [part.R_TM @ upper_arm, part.R_TM @ forearm]
    return found


def test_recorded_on_nao_played_on_icub() -> None:
    """At every time the limbs of both robots have equal directions in space, within 1 degree."""
    nao, icub = load_robot("nao"), load_robot("icub")
    seen: list[Tick] = []
    first = follow(
        SimulatedDriver(nao, world=World(nao, skin=False)), PlayGesture(fit(nao, wave())), observe=seen.append
    )
    assert first.phase is Phase.DONE
    times = np.array([tick.now for tick in seen])[::5]
    positions = np.array([tick.reading.joints.position for tick in seen])[::5]
    gesture = record(nao, times, positions)
    gesture = Gesture(gesture.times, {arm: gesture.postures[arm] for arm in ARMS})
    fitted = fit(icub, gesture)
    assert not fitted.missed
    played = []
    replayed: list[Tick] = []
    following = follow(
        SimulatedDriver(icub, world=World(icub, skin=False)), PlayGesture(fitted), observe=replayed.append
    )
    assert following.phase is Phase.DONE
    assert max(following.largest.values()) <= np.deg2rad(1.0)
    # The gesture ends at a known time of its own clock, so the clock follows from the remaining time.
    of = {"nao": KinematicChain(nao), "icub": KinematicChain(icub)}
    end = replayed[-1].now
    worst = 0.0
    for tick in replayed[:: len(replayed) // 100]:
        time = (fitted.gesture.duration - (end - tick.now)) / fitted.slower
        if time < 0.5:
            continue
        here = limbs(icub, of["icub"], tick.reading.joints.position)
        there = positions[int(np.argmin(np.abs(times - times[0] - time)))]
        pairs = zip(here, limbs(nao, of["nao"], there), strict=True)
        worst = max(worst, *(float(np.rad2deg(angle_between(a, b))) for a, b in pairs))
        played.append(time)
    print(
        f"{len(played)} instants, {fitted.slower:.2f} times as long, axes at most {worst:.2f} degrees apart"
    )
    assert len(played) > 50
    assert worst <= 1.0


def test_the_reflex_interrupts_and_the_gesture_goes_on() -> None:
    robot = load_robot("icub")
    world = World(robot)
    driver, skin = SimulatedDriver(robot, world=world), Skin(robot)
    site = default_fields()[2]
    phases: list[tuple[float, bool]] = []

    def touch(tick: Tick) -> None:
        phases.append((tick.now, bool(tick.perception.contacts)))
        if abs(tick.now - 1.5) < 1e-6:
            place = find_place(skin, "left_arm", site.segment, site.u, site.theta, tick.reading.joints)
            world.finger.poke(place.patch, place.p_L, place.n_L, speed=0.4, depth=0.015, gap=0.001)
        if abs(tick.now - 1.9) < 1e-6:
            world.finger.retire()

    fitted = fit(robot, wave())
    following = follow(driver, PlayGesture(fitted), reflexes=[WithdrawalReflex()], observe=touch)
    print(following)
    assert any(contact for _, contact in phases)
    assert following.interruptions == 1
    assert following.phase is Phase.DONE
    assert fitted.gesture.duration + 0.5 < following.duration < fitted.gesture.duration + 4.0
    assert max(following.largest.values()) <= np.deg2rad(1.0)
    assert driver.gate.counts.stops == 0


class GoesBlind(WithdrawalReflex):
    """A reflex that reports that its skin is blind after some time."""

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        return Reason(Code.SKIN_BLIND, "the field is blind") if perception.stamp > 0.3 else None


def test_a_reflex_that_goes_blind_stops_the_robot() -> None:
    icub = load_robot("icub")
    t = np.linspace(0.0, 0.5, 11)
    still = np.deg2rad(np.array([25.0, 25, 0, 60, 0]) + np.zeros((11, 1)))
    driver = SimulatedDriver(icub, world=World(icub, skin=False))
    follow(driver, PlayGesture(fit(icub, Gesture(t, {"left_arm": still}))), reflexes=[GoesBlind()])
    assert driver.gate.counts.stops == 1


def test_a_body_in_the_way_is_told() -> None:
    """If the arms hung as a person's arms do, the distance to iCub's body would be smaller than the gate
    permits."""
    icub = load_robot("icub")
    t = np.linspace(0.0, 1.0, 21)
    angles = np.deg2rad(np.array([25.0, 25, 0, 60, 0]) + np.outer(t, [-35.0, -25, -10, -30, 25]))
    world = World(icub, skin=False)
    following = follow(
        SimulatedDriver(icub, world=world), PlayGesture(fit(icub, Gesture(t, {"left_arm": angles})))
    )
    assert following.phase is Phase.DONE
    assert following.stopped
    assert all(" near " in pair for pair in following.stopped)
