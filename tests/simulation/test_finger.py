"""The simulated finger: its approach, its force, and its rest on the skin until it is retracted."""

from __future__ import annotations

import threading
from typing import Any

import mujoco
import numpy as np
import pytest

from tci.errors import CommandError, TciError, UnknownNameError
from tci.simulation.finger import STIFFNESS
from tci.simulation.world import World


def middle(world: World, patch: str) -> int:
    """Returns a taxel halfway along the patch."""
    return len(world.surfaces[patch].positions) // 2


def test_depth_gives_the_spring_s_force_and_the_contact_stays(world: World) -> None:
    for patch in filter(world.robot.limb_segment, world.robot.patches):
        for depth in (0.005, 0.010):
            world.reset()
            before = world.joints().position
            world.finger.poke(patch.name, middle(world, patch.name), depth=depth)
            world.advance(1.0)
            truth = world.contact_truth(patch.name)
            assert world.finger.touching
            assert world.finger.contact_lost is None
            # The skin yields by some tenths of a millimetre, because the stiffness of the servos is finite.
            assert 0.85 * STIFFNESS * depth < truth.force < 1.05 * STIFFNESS * depth
            assert truth.force == pytest.approx(world.finger.force, rel=1e-3)
            assert truth.vector @ truth.normal == pytest.approx(-truth.force, rel=1e-6)
            assert np.abs(world.joints().position - before).max() < np.deg2rad(0.5)


@pytest.mark.parametrize("speed", [0.05, 0.25, 0.5])
def test_it_comes_at_its_speed_from_its_gap_and_never_retreats(world: World, speed: float) -> None:
    patch = world.robot.patches[0].name
    world.finger.poke(patch, middle(world, patch), speed=speed, depth=0.008, gap=0.005)
    world.advance(0.5)
    time, force, path = world.finger.trace.T
    assert (np.diff(path) >= 0.0).all()
    moving = np.diff(path)[: int(0.004 / speed * 1e3)]
    assert moving == pytest.approx(speed * 0.001)
    assert world.finger.first_contact is not None
    assert world.finger.first_contact == pytest.approx(0.005 / speed, abs=0.003 + 0.0005 / speed)
    at_contact = path[time == world.finger.first_contact][0]
    assert path[-1] == pytest.approx(at_contact + 0.008, abs=1e-9)
    assert world.finger.peak_force == force.max()


def test_the_contact_does_not_chatter(world: World) -> None:
    patch = world.robot.patches[0].name
    world.finger.poke(patch, middle(world, patch))
    world.advance(0.5)
    time, force, _ = world.finger.trace.T
    assert (force[time >= world.finger.first_contact] > 0.0).all()


def test_contact_is_lost_when_the_arm_goes_away_and_the_finger_does_not_follow(nao: World) -> None:
    # The finger is on the upper side of the left arm. Lowering the shoulder moves the arm away.
    patch = "left_forearm"
    taxels = range(len(nao.surfaces[patch].positions))
    top = max(taxels, key=lambda taxel: nao.skin_point(patch, taxel)[1][2])
    nao.finger.poke(patch, top)
    nao.advance(0.2)
    assert nao.finger.touching
    servo = next(servo for servo in nao.robot.servos if servo.name == "LShoulderPitch")
    nao.set_position_targets([servo.index], [nao.joints().position[servo.index] + 0.3])
    nao.advance(0.6)
    assert not nao.finger.touching
    assert nao.finger.contact_lost is not None
    assert 0.2 < nao.finger.contact_lost < 0.4
    assert nao.finger.first_contact is not None
    assert (np.diff(nao.finger.trace[:, 2]) >= 0.0).all()
    assert nao.contact_truth(patch).force == 0.0


def test_skin_that_comes_late_is_pressed_at_the_same_speed(nao: World) -> None:
    """The finger waits in the air, at the end of its path, until the arm returns."""
    servo = next(servo for servo in nao.robot.servos if servo.name == "LShoulderPitch").index
    here = nao.joints().position[servo]
    nao.finger.poke("left_forearm", 5, speed=0.02, depth=0.008, gap=0.006)
    nao.set_position_targets([servo], [here + 0.3])
    nao.advance(1.2)
    assert nao.finger.first_contact is None
    nao.set_position_targets([servo], [here])
    nao.advance(2.5)
    assert nao.finger.first_contact is not None
    path = nao.finger.trace[:, 2]
    assert path[-1] == pytest.approx(0.006 + 2 * 0.008)
    assert np.diff(path).max() == pytest.approx(0.02 * nao.step)


def test_it_can_be_placed_again_and_retired(world: World) -> None:
    for patch in world.robot.patches[:2]:
        world.finger.poke(patch.name, middle(world, patch.name))
        world.advance(world.time + 0.2)
        assert world.contact_truth(patch.name).force > 5.0
    world.finger.retire()
    assert not world.finger.touching
    assert world.finger.first_contact is None
    assert len(world.finger.trace) == 0
    world.advance(world.time + 0.05)
    assert all(world.contact_truth(patch.name).force == 0.0 for patch in world.robot.patches)


def test_a_point_of_the_torso_is_the_same_as_one_of_the_skin(world: World) -> None:
    patch = world.robot.patches[0].name
    point, normal = world.skin_point(patch, middle(world, patch))
    world.finger.poke(patch, middle(world, patch))
    world.advance(0.2)
    expected = world.contact_truth(patch)
    world.reset()
    world.finger.poke_at(point, 3.0 * normal)
    world.advance(0.2)
    truth = world.contact_truth(patch)
    assert truth.force == pytest.approx(expected.force, rel=1e-9)
    assert truth.center == pytest.approx(expected.center, abs=1e-9)


def test_it_touches_nothing_but_skin(nao: World) -> None:
    nao.finger.poke_at(np.array([0.07, 0.0, 0.05]), np.array([1.0, 0.0, 0.0]), depth=0.03)
    nao.advance(0.4)
    assert nao.finger.peak_force == 0.0
    assert nao.finger.first_contact is None


def test_no_room_is_an_error_that_names_what_is_in_the_way(nao: World) -> None:
    patch = nao.robot.patches[0].name
    point, normal = nao.skin_point(patch, middle(nao, patch))
    with pytest.raises(TciError, match=f"inside tci_skin_{patch}"):
        nao.finger.poke_at(point - 0.02 * normal, normal)
    nao.advance(0.05)
    assert nao.finger.peak_force == 0.0


def test_bad_input_says_what_is_valid(nao: World) -> None:
    patch = nao.robot.patches[0].name
    with pytest.raises(UnknownNameError, match=patch):
        nao.finger.poke("left_toe", 0)
    with pytest.raises(CommandError, match="valid: 0 to"):
        nao.finger.poke(patch, 100_000)
    with pytest.raises(CommandError, match="three finite numbers"):
        nao.finger.poke(patch, [0.0, np.nan, 0.0])
    with pytest.raises(CommandError, match="no direction"):
        nao.finger.poke(patch, 0, [0.0, 0.0, 0.0])
    for name, value in (("speed", 0.0), ("depth", -0.001), ("gap", np.inf)):
        with pytest.raises(CommandError, match=f"{name} {value}"):
            nao.finger.poke(patch, 0, **{name: value})


def test_another_thread_does_not_step_during_a_poke(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo lets other threads run while it computes poses. A step at this time crashed Python."""
    patch, forward, times = world.robot.patches[0].name, mujoco.mj_forward, []
    stepper = threading.Thread(target=world.advance, args=[world.time + 0.02])

    def slow(model: Any, data: Any) -> None:
        if stepper.ident is None:
            stepper.start()
            stepper.join(0.2)
        forward(model, data)
        times.append(world.time)

    monkeypatch.setattr(mujoco, "mj_forward", slow)
    world.finger.poke(patch, middle(world, patch))
    stepper.join()
    assert set(times) == {times[0]}
    assert world.time > times[0]
