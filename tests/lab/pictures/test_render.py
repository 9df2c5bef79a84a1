"""Pictures that are computed by ray casting are compared with geometry, not with other pictures."""

import subprocess
import sys
import threading
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tci.errors import TciError
from tci.lab.pictures.camera import Camera, fit, look_at, pixel_centres, project, rays
from tci.lab.pictures.cast import Caster
from tci.lab.pictures.paint import FieldLook, FieldPaint, TaxelPaint, pressure_colours
from tci.lab.pictures.render import model_colours, render

SPHERE = """<mujoco><worldbody>
  <geom name="ball" type="sphere" size="0.1" rgba="0.2 0.6 0.3 1"/>
  <geom name="hidden" type="sphere" size="0.15" group="3"/>
  <geom name="clear" type="sphere" size="0.15" rgba="1 1 1 0"/>
</worldbody></mujoco>"""
BALL = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, 0.0]])
TWO = """<mujoco><worldbody>
  <geom name="near" type="sphere" size="0.1" pos="0.3 0 0"/>
  <geom name="far" type="box" size="0.01 1 1" pos="-0.5 0 0"/>
</worldbody></mujoco>"""

GREY = np.array([[0.5, 0.5, 0.5, 1.0]] * 2)

angles = st.floats(-3.0, 3.0)


def scene(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def camera(size: int = 200) -> Camera:
    return look_at((0, 0, 0), azimuth=0.4, elevation=0.3, distance=1.0, fov=0.4, width=size, height=size)


def test_no_two_threads_cast_on_the_same_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo's working memory belongs to its data object. When two threads shared the object, the process
    sometimes crashed."""
    model, data = scene(SPHERE)
    together, used, plain = threading.Barrier(2), [], mujoco.mj_multiRay

    def cast(model: mujoco.MjModel, data: mujoco.MjData, *rest: Any) -> None:
        used.append(id(data))
        together.wait(40.0)
        plain(model, data, *rest)

    monkeypatch.setattr("tci.lab.pictures.cast.os.cpu_count", lambda: 2)
    monkeypatch.setattr(mujoco, "mj_multiRay", cast)
    view = camera(100)
    hits = Caster(model, data, BALL).cast(view, pixel_centres(view))
    assert len(set(used)) == len(used) == 2
    assert set(hits.geom) == {-1, 0}


def test_sphere_has_its_size_distance_and_normal() -> None:
    model, data = scene(SPHERE)
    view = camera()
    hits = Caster(model, data, BALL).cast(view, pixel_centres(view))
    # A sphere of radius r at distance d fills a cone with the half angle asin(r / d).
    radius = view.focal * np.tan(np.arcsin(0.1))
    assert set(hits.geom) == {-1, 0}
    assert np.count_nonzero(hits.geom == 0) == pytest.approx(np.pi * radius**2, rel=0.005)
    middle = Caster(model, data, BALL).cast(view, np.array([[100.0, 100.0]]))
    towards = view.T_WC[:3, 3]
    assert middle.distance[0] == pytest.approx(0.9, abs=1e-9)
    assert middle.normals[0] == pytest.approx(towards, abs=1e-6)
    hit = hits.geom == 0
    assert hits.points[hit] == pytest.approx(0.1 * hits.normals[hit], abs=1e-6)
    assert np.all(np.isinf(hits.distance[~hit]))


def test_colours_come_from_the_model_and_the_light() -> None:
    model, data = scene(SPHERE)
    picture = render(model, data, camera())
    middle = picture[100, 100].astype(float)
    assert picture.shape == (200, 200, 3)
    assert picture.dtype == np.uint8
    assert middle / middle[1] == pytest.approx(np.array([0.2, 0.6, 0.3]) / 0.6, abs=0.02)
    assert picture[0, 0].min() > 225  # background
    above, below = picture[75, 100].sum(), picture[125, 100].sum()
    assert above > below  # the light comes from above


def test_the_picture_is_deterministic_and_leaves_the_model_alone() -> None:
    model, data = scene(TWO)
    groups = model.geom_group.copy()
    assert np.array_equal(render(model, data, camera()), render(model, data, camera()))
    assert np.array_equal(model.geom_group, groups)


def test_outlines_are_soft() -> None:
    model, data = scene(SPHERE)
    row = render(model, data, camera())[100].astype(int).sum(axis=1)
    assert len(np.unique(row[:120])) > 10
    inside = row[100]
    assert row.min() < inside  # the outline of the ball is darker than the ball


def test_pieces_of_one_body_and_colour_have_no_line_between_them() -> None:
    xml = """<mujoco><worldbody>
      <geom type="box" size="0.1 0.1 0.1" pos="0 0.1 0"/><geom type="box" size="0.1 0.1 0.1" pos="0 -0.1 0"/>
    </worldbody></mujoco>"""
    model, data = scene(xml)
    front = look_at((0, 0, 0), azimuth=0.0, elevation=0.0, distance=2.0, width=100, height=100)
    colours = np.full((2, 4), 1.0)
    assert np.ptp(render(model, data, front, colours=colours)[50, 45:55].astype(int)) == 0
    colours[1, :3] = 0.9
    assert np.ptp(render(model, data, front, colours=colours)[50, 45:55].astype(int)) > 50


def test_colours_choose_what_is_drawn() -> None:
    model, data = scene(SPHERE)
    assert list(model_colours(model)[:, 3]) == [1.0, 0.0, 0.0]
    colours = np.array([[0.2, 0.6, 0.3, 1.0], [0.5, 0.5, 0.5, 0.0], [0.8, 0.1, 0.1, 1.0]])
    drawn = render(model, data, camera(50), colours=colours)[25, 25].astype(int)
    assert drawn[0] > 3 * drawn[1]  # the shell is shown although the model makes it invisible


def test_glass_shows_what_is_behind_it() -> None:
    model, data = scene(SPHERE)
    colours = np.array([[0.2, 0.6, 0.3, 1.0], [0.5, 0.5, 0.5, 0.0], [0.8, 0.1, 0.1, 0.0]])
    levels = []
    for alpha in (0.0, 0.25, 0.5, 0.75, 1.0):
        colours[2, 3] = alpha
        levels.append(render(model, data, camera(50), colours=colours)[25, 25].astype(float))
    for alpha, level in zip((0.25, 0.5, 0.75), levels[1:4], strict=True):
        assert level == pytest.approx((1 - alpha) * levels[0] + alpha * levels[4], abs=2.0)
    colours[2, 3] = 0.5
    through = render(model, data, camera(), colours=colours)
    assert through[100, 145, 0] > through[100, 145, 1]  # beside the ball and inside the shell
    # Transparent objects behind an opaque ball are not visible.
    model, data = scene(TWO)
    colours = np.array([[0.2, 0.6, 0.3, 1.0], [0.8, 0.1, 0.1, 0.5]])
    front = look_at((0.3, 0, 0), azimuth=0.0, elevation=0.0, distance=1.0, width=50, height=50)
    red, green, _ = render(model, data, front, colours=colours)[25, 25].astype(int)
    assert green > 2 * red


@given(azimuth=angles, elevation=st.floats(-1.5, 1.5), distance=st.floats(0.1, 10.0), seed=st.integers(0, 99))
def test_projection_undoes_the_rays(azimuth: float, elevation: float, distance: float, seed: int) -> None:
    view = look_at(
        (0.3, -0.2, 1.0),
        azimuth=azimuth,
        elevation=elevation,
        distance=distance,
        width=320,
        height=200,
    )
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), (320, 200), (20, 2))
    reach = rng.uniform(0.1, 5.0, 20)
    directions = rays(view, pixels)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(20))
    points = view.T_WC[:3, 3] + reach[:, None] * directions
    found, depth = project(view, points)
    assert found == pytest.approx(pixels, abs=1e-6)
    assert depth == pytest.approx(reach * (directions @ view.T_WC[:3, 2]), rel=1e-9)
    assert np.isnan(project(view, view.T_WC[:3, 3] - directions)[0]).all()
    # The target point of the camera is in the middle of the picture, and the upward direction points up.
    (centre, above), _ = project(view, np.array([[0.3, -0.2, 1.0], [0.3, -0.2, 1.01]]))
    assert centre == pytest.approx([160, 100], abs=1e-6)
    assert above[1] < centre[1]


@given(azimuth=angles, elevation=st.floats(-1.5, 1.5), seed=st.integers(0, 99))
def test_a_fit_shows_all_and_fills_the_picture(azimuth: float, elevation: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=3) + rng.uniform(-1.0, 1.0, (30, 3)) * rng.uniform(0.05, 0.5, 3)
    view = fit(points, azimuth=azimuth, elevation=elevation, margin=0.05, width=300, height=400)
    pixels, depth = project(view, points)
    assert depth.min() > 0.0
    room = np.stack([pixels.min(axis=0), [300, 400] - pixels.max(axis=0)])
    assert (room > np.array([300, 400]) * 0.05 - 1e-6).all()
    assert np.min(room.sum(axis=0) / [300, 400]) == pytest.approx(0.1, abs=1e-6)
    assert room[0] == pytest.approx(room[1], abs=1e-6)


def test_right_is_right() -> None:
    view = look_at((0, 0, 0), azimuth=0.0, elevation=0.0, distance=1.0)
    left_of_robot, _ = project(view, np.array([[0.0, 0.1, 0.0]]))
    assert left_of_robot[0, 0] > view.width / 2  # seen from the front, the robot's left is on the right


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"distance": 0.0}, "distance 0.0"),
        ({"distance": float("nan")}, "distance nan"),
        ({"fov": 3.2}, "angle of view 3.2"),
        ({"elevation": 1.6}, "elevation 1.6"),
        ({"width": 0}, "0 x 600"),
    ],
)
def test_impossible_cameras_are_refused(wrong: dict[str, float], message: str) -> None:
    arguments: dict[str, float] = {"azimuth": 0.0, "elevation": 0.0, "distance": 1.0} | wrong
    with pytest.raises(TciError, match=message):
        look_at((0, 0, 0), **arguments)


def coloured(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Returns a mask of the pixels that are not grey."""
    values = picture.astype(int)
    marked: NDArray[np.bool_] = np.ptp(values, axis=2) > 40
    return marked


def test_taxels_are_drawn_where_they_are_seen() -> None:
    model, data = scene(TWO)
    view = look_at((0, 0, 0), azimuth=0.0, elevation=0.0, distance=2.0, fov=0.5, width=300, height=300)
    front = np.array([[1.0, 0.0, 0.0]])
    # One point on the ball, one on the wall beside the ball, one on the wall behind the ball.
    taxels = np.array([[0.4, 0.0, 0.0], [-0.49, 0.3, 0.2], [-0.49, 0.0, 0.0]])
    pressure = np.full(1, 5e4)
    for taxel, shown in zip(taxels, (True, True, False), strict=True):
        paint = TaxelPaint(taxel[None], front, pressure, full_scale=6e4, radius=0.02)
        marked = coloured(render(model, data, view, paint=[paint], colours=GREY))
        assert marked.any() == shown
        if shown:
            rows, columns = np.nonzero(marked)
            (pixel,), (depth,) = project(view, taxel[None])
            assert [columns.mean() + 0.5, rows.mean() + 0.5] == pytest.approx(pixel, abs=1.0)
            radius = 0.02 * (1.0 + 5 / 6) * view.focal / depth
            assert marked.sum() == pytest.approx(np.pi * radius**2, rel=0.2)
    turned = TaxelPaint(taxels[:1], -front, pressure, full_scale=6e4, radius=0.02)
    assert not coloured(render(model, data, view, paint=[turned], colours=GREY)).any()


def test_pressure_has_its_colours() -> None:
    colours = pressure_colours(np.array([0.0, 1e4, 2e4, 1e9]), 2e4)
    assert np.array_equal(colours[2], colours[3])
    brightness = pressure_colours(np.linspace(0, 2e4, 50), 2e4) @ np.array([0.21, 0.72, 0.07])
    assert brightness[-1] > brightness[0]
    assert len(np.unique(np.round(colours, 6), axis=0)) == 3


def test_fields_are_painted_on_the_side_where_they_are() -> None:
    model, data = scene(
        """<mujoco><worldbody>
        <geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.2" rgba="0.5 0.5 0.5 1"/>
        </worldbody></mujoco>"""
    )
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    height = np.linspace(0.0, -0.2, 21)
    ring = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle)], axis=1)
    skin = np.array([[x, y, z] for z in height for x, y in ring])
    flexor = FieldLook("forearm", u=0.5, theta=0.0, radius=0.25, colour=(0.9, 0.1, 0.1), strength=0.8)
    lateral = FieldLook("forearm", u=0.5, theta=np.pi / 2, radius=0.1, colour=(0.1, 0.1, 0.9), strength=0.8)
    paint = FieldPaint(skin, skin * [25.0, 25.0, 0.0], np.eye(4), 0.2, "left", [flexor, lateral])
    shares = {}
    for name, azimuth in {"flexor": 0.0, "lateral": np.pi / 2, "extensor": np.pi}.items():
        view = look_at(
            (0, 0, -0.1), azimuth=azimuth, elevation=0.0, distance=1.0, fov=0.3, width=200, height=200
        )
        values = render(model, data, view, paint=[paint]).astype(int)
        red = values[..., 0] - values[..., 2]
        shares[name] = int((red > 60).sum()), int((red < -60).sum())
    assert shares["flexor"][0] > 300
    assert shares["lateral"][1] > 100
    assert shares["lateral"][0] < 0.3 * shares["flexor"][0]
    assert shares["extensor"][0] == 0
    # only the rim of the disc, which is seen edge-on
    assert shares["extensor"][1] < 0.2 * shares["lateral"][1]


def test_no_graphics_library_is_needed() -> None:
    program = f"""
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("OpenGL", "glfw"):
            raise ImportError(name + " is not here")
sys.meta_path.insert(0, Refuse())
import mujoco
from tci.lab.pictures.camera import look_at
from tci.lab.pictures.render import render
model = mujoco.MjModel.from_xml_string({SPHERE!r})
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
picture = render(model, data, look_at((0, 0, 0), azimuth=0, elevation=0, distance=1, width=40, height=40))
assert picture[20, 20, 1] > picture[20, 20, 0]
maps = open("/proc/self/maps").read()
assert not [lib for lib in ("libGL", "libEGL", "libOSMesa") if lib in maps], maps
print("drawn")
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"MUJOCO_GL": "disabled", "PATH": "", "PYTHONPATH": ":".join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "drawn", done.stderr
