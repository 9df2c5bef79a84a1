"""What a robot sees with its head: MuJoCo's renderer over EGL against TCI's own, and where the eyes are."""

from __future__ import annotations

import logging
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.lab.pictures.camera import pixel_centres
from tci.lab.pictures.cast import Caster
from tci.lab.pictures.gl import GlRenderer
from tci.lab.pictures.head_camera import HeadCamera
from tci.lab.pictures.portrait import keep_moment
from tci.learn import NamedRobot, TouchEnv
from tci.robot.catalogue import load_robot

RAISED = {part: [1.0, 0.1, 0.0, 0.6, 0.0] for part in ("left_arm", "right_arm")}


def test_both_renderers_see_the_arms_at_the_same_place() -> None:
    pytest.importorskip("OpenGL", reason="extra camera")
    driver = SimulatedDriver(robot := load_robot("g1"), world=tci.World(robot, posture=RAISED))
    moment = keep_moment(driver.world, driver.read())
    eyes = HeadCamera(driver.world, width=80, height=60, over="own")
    camera, portrait = eyes.camera(moment), eyes.portrait
    data = portrait.pose(moment)
    hits = Caster(portrait.model, data, portrait.colours).cast(camera, pixel_centres(camera))
    seen = (hits.geom >= 0).reshape(60, 80)
    assert seen.mean() > 0.1, "the arms are in the picture"
    black = portrait.colours * [0.0, 0.0, 0.0, 1.0]
    drawn = GlRenderer(portrait.model, black, width=80, height=60).draw(data, camera).max(axis=2) < 120
    assert (drawn == seen).mean() > 0.97


@pytest.mark.parametrize(("name", "down"), [("nao", 1.2), ("icub", 0.0), ("g1", 47.6), ("talos", 0.0)])
def test_eyes_look_ahead_and_turn_with_the_head(name: str, down: float) -> None:
    robot = load_robot(name)
    body = tci.GenericBody(robot)
    head = next(part.name for part in robot.parts if part.kind == "head")
    for nod in (0.0, 0.2):
        turned = {head: np.array([nod, 0.0, 0.0])} if body.turns_gaze == head and name != "g1" else {}
        world = tci.World(robot, posture=turned, skin=False)
        T_TC = body.eyes(world.joints())
        angle = np.deg2rad(down) + (nod if turned else 0.0)
        np.testing.assert_allclose(T_TC[:3, 2], [np.cos(angle), 0.0, -np.sin(angle)], atol=5e-3)
        np.testing.assert_allclose(T_TC[:3, 0], [0.0, -1.0, 0.0], atol=5e-3)
        assert T_TC[2, 3] > 0.05, "above the torso's origin"


def test_without_egl_it_draws_all_the_same_and_says_how_slow(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "OpenGL", None)
    driver = tci.connect("nao")
    camera = HeadCamera(driver.world, width=8, height=6)
    with caplog.at_level(logging.WARNING, "tci"):
        assert camera.picture(driver.read()).shape == (6, 8, 3)
        camera.picture(driver.read())
    (said,) = [record.message for record in caplog.records]
    assert "s of processor time" in said
    assert "pip install" in said
    with pytest.raises(TciError, match="OpenGL"):
        HeadCamera(driver.world, over="egl")
    with pytest.raises(TciError, match="valid: egl, own"):
        HeadCamera(driver.world, over="glfw")


def test_pictures_are_observations() -> None:
    env = TouchEnv("nao", "reach", duration=0.1, picture=(16, 12))
    env.spec = gymnasium.spec("tci/Reach-v0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    with NamedRobot("nao", picture=(16, 12)) as robot:
        assert robot.pictures == {"head": (12, 16, 3)}
        assert robot.observe()["head"].shape == (12, 16, 3)
    with pytest.raises(TciError, match="at least 1 x 1"):
        TouchEnv(picture=(0, 12))
