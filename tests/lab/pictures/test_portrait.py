"""Portraits of a poked robot show pressure, receptive fields and finger at the positions of the
simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tci.lab.pictures.camera import Camera, look_at, project
from tci.lab.pictures.film import _people_of
from tci.lab.pictures.paint import FieldLook
from tci.lab.pictures.portrait import Moment, Portrait, keep_moment
from tci.messages import Reading
from tci.messages.frames import apply
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot
from tci.simulation.world import World

FIELD = FieldLook("forearm", 0.6, 0.0, 0.3, (0.1, 0.9, 0.1), strength=0.9)
PATCH = "left_forearm"


@pytest.fixture(scope="module")
def shared() -> World:
    return World(load_robot("nao"))


@pytest.fixture
def nao(shared: World) -> World:
    shared.reset()
    return shared


def test_a_recording_shows_hands_and_finger_where_they_were(tmp_path: Path) -> None:
    """Both as drawn while the world ran, and from the recording alone."""
    world = World("nao", people=1)
    world.touch("stroke 'left forearm' 3N 8cm/s")
    world.finger.poke("right_forearm", 120)
    world.advance(0.6)
    recorder, live = Recorder(tmp_path / "touch.mcap", "nao"), moment(world)
    recorder.tick(world.time, live.reading, touching=world.touching())
    recorder.close()
    ((_, poses),) = Recording(recorder.path).touching()
    assert len(poses) == 7, "six pads and the finger"
    other = World("nao", people=_people_of(poses))
    (tick,) = Recording(recorder.path).ticks()
    other.show(tick.reading.joints.position)
    shown = keep_moment(other, tick.reading)
    other.show_touching(shown.data, poses)
    for portrait, kept in (
        (Portrait(world, (), full_scale=1e5), live), (Portrait(other, (), full_scale=1e5), shown)
    ):  # fmt: skip
        drawn = portrait.pose(kept)
        for body in poses:
            np.testing.assert_allclose(drawn.body(body).xpos, live.data.body(body).xpos, atol=2e-4)
            np.testing.assert_allclose(drawn.body(body).xmat, live.data.body(body).xmat, atol=1e-3)


def moment(world: World) -> Moment:
    return keep_moment(world, Reading(world.joints(), world.frames()))


def view(world: World, portrait: Portrait, kept: Moment, taxel: int) -> Camera:
    """Returns a close view from a direction 50 degrees away from the taxel's normal, so that the finger does
    not hide the taxel."""
    point, normal = world.skin_point(PATCH, taxel)
    aside = np.cross(normal, [0.0, 0.0, 1.0])
    outward = np.cos(0.9) * normal + np.sin(0.9) * aside / np.linalg.norm(aside)
    return look_at(
        point,
        azimuth=float(np.arctan2(outward[1], outward[0])),
        elevation=float(np.arcsin(outward[2])),
        distance=0.2,
        fov=0.4,
        width=160,
        height=160,
        frame=portrait.torso(kept),
    )


def warm(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Returns a mask of the pixels of pressed taxels, which are red and contain little blue."""
    values = picture.astype(int)
    found: NDArray[np.bool_] = (values[..., 0] > 140) & (values[..., 0] - values[..., 2] > 90)
    return found


def test_a_pressed_taxel_glows_and_looking_changes_nothing(nao: World) -> None:
    taxel = len(nao.surfaces[PATCH].positions) // 2
    portrait = Portrait(nao, [], full_scale=2e4)
    before = moment(nao)
    nao.finger.poke(PATCH, taxel)
    nao.advance(0.1)
    state = nao.data.qpos.tobytes(), nao.time
    after = moment(nao)
    camera = view(nao, portrait, after, taxel)
    glow = warm(portrait.draw(after, camera))
    assert not warm(portrait.draw(before, camera)).any()
    assert glow.sum() > 20
    rows, columns = np.nonzero(glow)
    point, _ = nao.skin_point(PATCH, taxel)
    (pixel,), _ = project(camera, apply(portrait.torso(after), point[None]))
    assert np.linalg.norm(pixel - [columns.mean(), rows.mean()]) < 0.012 / 0.2 * camera.focal
    assert (nao.data.qpos.tobytes(), nao.time) == state


def test_a_kept_moment_stays_while_the_world_goes_on(nao: World) -> None:
    portrait = Portrait(nao, [], full_scale=2e4)
    kept = moment(nao)
    camera = look_at((0, 0, 0), azimuth=0.6, elevation=0.2, distance=1.4, width=60, height=60)
    picture = portrait.draw(kept, camera)
    servo = next(s.servo for s in nao.robot.part("left_arm").servos if s.servo is not None)
    nao.set_position_targets([servo], nao.joints().position[[servo]] - 0.5)
    nao.advance(0.6)
    assert np.array_equal(portrait.draw(kept, camera), picture)
    assert not np.array_equal(portrait.draw(moment(nao), camera), picture)


def test_fields_tint_the_skin_of_both_arms(nao: World) -> None:
    kept = moment(nao)
    plain, tinted = Portrait(nao, [], full_scale=2e4), Portrait(nao, [FIELD], full_scale=2e4)
    T_WT = plain.torso(kept)
    for side in (1.0, -1.0):
        camera = look_at((0.1, side * 0.12, 0.0), azimuth=0.0, elevation=0.8, distance=1.0, width=150,
                         height=150, frame=T_WT)  # fmt: skip
        difference = tinted.draw(kept, camera).astype(int) - plain.draw(kept, camera)
        assert (difference[..., 1] > 40).sum() > 30
        assert difference[..., 2].max() < 10  # green comes, blue never


def test_the_outline_leaves_out_the_other_arm_and_the_legs(nao: World) -> None:
    portrait = Portrait(nao, [], full_scale=2e4)
    kept = moment(nao)
    points = {
        part: portrait.outline(kept, part=part, lowest=-0.05) - portrait.torso(kept)[:3, 3]
        for part in ("left_arm", "right_arm")
    }
    assert points["left_arm"][:, 1].max() > -points["left_arm"][:, 1].min() + 0.03
    mirrored = [-points["right_arm"][:, 1].min(), -points["right_arm"][:, 1].max()]
    assert mirrored == pytest.approx(
        [points["left_arm"][:, 1].max(), points["left_arm"][:, 1].min()], abs=0.02
    )
    assert points["left_arm"][:, 2].min() >= -0.05


@pytest.mark.parametrize("skin", [[PATCH], False])
def test_a_robot_that_wears_part_of_its_skin_has_a_portrait(skin: bool | list[str]) -> None:
    world = World(load_robot("nao"), skin=skin)
    portrait = Portrait(world, [FIELD], full_scale=40e3)
    camera = look_at((0, 0, 0), azimuth=0.5, elevation=0.3, distance=1.5, width=200, height=200)
    picture = portrait.draw(moment(world), camera)
    green = (picture[..., 1] > 1.3 * picture[..., 0].astype(float)).any()
    assert green == bool(skin)
