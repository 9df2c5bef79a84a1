"""Finds the tactile pads that a model already has, in URDF, MJCF and SDF.

A pad shows as a fixed link with a telling name (with a mesh: a pad with an outline; empty: one taxel, or a
module of iCub's skin), as a site that a touch sensor of MuJoCo uses, or as a tactile sensor of ROS'
tactile_toolbox. Contact sensors of whole links, range finders, and surfaces that are only called pad are left
out, and listed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np
from lxml import etree

from tci.errors import DescriptionError, Fault, UnknownNameError
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.pad_outline import Outline, best_axis, outline, outward
from tci.lab.authoring.pad_words import claims, finger, offers, stem
from tci.lab.authoring.sdf_model import sdf_as_urdf
from tci.messages.frames import Array, apply, invert, rpy_of, transform
from tci.robot.description import Grid, Model
from tci.robot.mesh_files import NO_MESHES
from tci.robot.model_file import BOUND_MASS, load_spec
from tci.robot.model_format import model_format
from tci.robot.skin_files.urdf import read_tactile_sensors
from tci.robot.tactile_devices import Device, DevicePad, best_fit, device
from tci.robot.xml.document import parse, read_bytes
from tci.robot.xml.model import MAX_MODEL_BYTES
from tci.skin.surfaces import grid_taxels
from tci.support.engine import mujoco

HEAVIEST = 0.05
"""Mass [kg] above which a fixed link with a telling name is a cover and no pad. Assumed: published pads have
1 g."""
SMALL = 0.008
"""Side [m] of the place that a taxel without an outline is taken to cover. Assumed."""
SKIN_MODULE, PER_MODULE = "skin", 10
"""Last word of the names of iCub's triangular modules, and taxels that the frame of one stands for."""
APART = 0.010
"""Distance [m] below which two such frames are single taxels: modules have sides of 30 mm, and their middles
are 17 mm apart or more on an iCub; the taxels of its fingertips 4 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Pad:
    """One pad of a model, or an array of single taxels."""

    name: str
    """A name that a description may use, which no other pad of the model has."""
    how: str
    """What it is in the model, in words."""
    link: str
    """Link in whose frame the taxels are."""
    members: tuple[str, ...]
    """Elements of the model that it was made of."""
    positions: Array
    """Places (n, 3) [m] of the taxels."""
    normals: Array
    grid: Grid | None = None
    device: Device | None = None
    """Device whose pad has the size of the outline; None if the table has none."""
    thickness: float = 0.0
    """Depth [m] of the pad's shape; 0 if the model has none."""
    solid: bool = True
    """True if the model's own shapes collide where the pad is."""
    modules: tuple[str, ...] = ()
    """Frames of triangular modules, if it consists of these."""

    @property
    def taxels(self) -> int:
        return PER_MODULE * len(self.modules) if self.modules else len(self.positions)

    @property
    def is_table(self) -> bool:
        """True if its taxels are neither a grid nor modules, so that only a table can describe them."""
        return bool(self.taxels) and self.grid is None and not self.modules


@dataclass(frozen=True, slots=True, eq=False)
class FoundPads:
    """The pads of one model, and what looks like pads and is left out."""

    model: Model
    pads: tuple[Pad, ...]
    left_out: Mapping[str, tuple[str, ...]]
    """Names of elements that were not taken, by the reason."""
    notes: tuple[str, ...] = ()

    @property
    def members(self) -> int:
        """Number of elements of the model that are pads."""
        return sum(len(pad.members) for pad in self.pads)

    def lines(self) -> list[str]:
        """What was found, used and left out, in words."""
        lines = [f"{self.members} pads in the model, {sum(pad.taxels for pad in self.pads)} taxels"]
        for owner in {pad.device.name: pad.device for pad in self.pads if pad.device is not None}.values():
            own = [pad for pad in self.pads if pad.device is owner]
            lines.append(
                f"{len(own)} of them have the sizes of {owner.title} ({owner.name}): rows, columns and order "
                "are its; that row 1 lies at the far end is assumed: press a corner to see. The real ones "
                f'are felt with --via "... + {owner.read_by}:ADDRESS", or <source> in a binding of the robot'
            )
        unknown = [
            pad for pad in self.pads if pad.device is None and pad.grid is not None and pad.taxels == 1
        ]
        if unknown:
            lines.append(f"{len(unknown)} count as one taxel each: no device of the table has their size")
        lines += self.notes
        for why, names in self.left_out.items():
            shown = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
            lines.append(f"left out, {why}: {shown}")
        return lines


@dataclass
class _Search:
    model: Model
    points: LinkPoints
    pads: list[Pad] = field(default_factory=list)
    left_out: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def leave(self, why: str, name: str) -> None:
        self.left_out.setdefault(why, []).append(name)


def find_pads(
    path: Path, *, meshes: str | None = None, also: Collection[str] = (), wanted: str | None = None,
    radians: bool = False,
) -> FoundPads:  # fmt: skip
    """Finds the pads of the URDF, MJCF or SDF file at `path`, of any robot.

    If meshes are missing, pads without an outline become single taxels, which the result's notes say.

    Args:
        meshes: Folder with the meshes that are not at their paths; "none" to do without.
        also: Links to take although nothing says that they feel, such as `left_pad`.
        radians: As in `tci.robot.description.Model`.
        wanted: Name of the device that the pads belong to, if sizes can't tell it.

    Raises DescriptionError for a file that can't be read, UnknownNameError for a link or a device that isn't
    there.
    """
    if not path.is_file():
        raise DescriptionError(str(path), [Fault(0, "no such file; valid: a URDF, MJCF or SDF file")])
    root = parse(read_bytes(path, limit=MAX_MODEL_BYTES), str(path))
    if root.tag == "sdf" or etree.QName(root).namespace:
        with TemporaryDirectory() as folder:
            made = Path(folder, f"{path.stem}.urdf")
            made.write_bytes(etree.tostring(_plain(root) if root.tag != "sdf" else sdf_as_urdf(path, root)))
            return _search(made, root, meshes, also, wanted, radians)
    return _search(path, root, meshes, also, wanted, radians)


def _search(
    path: Path, root: etree._Element, meshes: str | None, also: Collection[str], wanted: str | None,
    radians: bool,
) -> FoundPads:  # fmt: skip
    model = Model(
        format=model_format(path), path=str(path.resolve()), meshes=meshes, radians=radians, torso_link="?"
    )
    notes = []
    try:
        points = LinkPoints(model)
    except DescriptionError as error:
        if meshes is not None:
            raise
        model = model.model_copy(update={"meshes": NO_MESHES})
        points = LinkPoints(model)
        notes.append(f"read without meshes, so that only boxes have an outline: {error.faults[0].message}")
    return pads_of(model, points, root, also=also, wanted=wanted, notes=notes)


def pads_of(
    model: Model, points: LinkPoints, root: etree._Element, *, also: Collection[str] = (),
    wanted: str | None = None, notes: Sequence[str] = (),
) -> FoundPads:  # fmt: skip
    """The same for a model that is loaded already; `root` is its file, in which Gazebo's sensors are."""
    search = _Search(model, points, notes=list(notes))
    names = [str(points.compiled.body(body).name) for body in range(1, points.compiled.nbody)]
    for name in also:
        if name not in names:
            raise UnknownNameError("link", name, names)
    _links(search, also, None if wanted is None else device(wanted))
    if model.format == "mjcf":
        _sensors(search)
    _of_ros(search, root)
    _of_gazebo(search, root)
    # A link on which sensors or sites are found is their frame, not a pad of its own.
    frames = {pad.link for pad in search.pads if pad.members != (pad.link,)}
    search.pads = [pad for pad in search.pads if pad.members != (pad.link,) or pad.link not in frames]
    left = {why: tuple(names) for why, names in search.left_out.items()}
    return FoundPads(model, tuple(_named(_arrays(search))), left, tuple(search.notes))


def _plain(root: etree._Element) -> etree._Element:
    """A copy without XML namespaces, which some old URDF files have."""
    copied = deepcopy(root)
    for element in copied.iter("{*}*"):
        element.tag = etree.QName(element).localname
    etree.cleanup_namespaces(copied)
    return copied


def _links(search: _Search, also: Collection[str], wanted: Device | None) -> None:
    model = search.points.compiled
    for body in range(1, model.nbody):
        name = str(model.body(body).name)
        if not claims(name) and name not in also:
            if offers(name):
                search.leave("a surface, of which nothing says that it feels: take it with --also", name)
            continue
        if model.body_jntnum[body] or not model.body_parentid[body]:
            search.leave("a link that moves, not a pad on one", name)
        elif model.body_mass[body] > HEAVIEST:
            search.leave(f"a cover of more than {1e3 * HEAVIEST:.0f} g", name)
        else:
            search.pads.append(_of_link(search, body, name, wanted))


def _of_link(search: _Search, body: int, name: str, wanted: Device | None) -> Pad:
    points, model = search.points, search.points.compiled
    carrier = int(model.body_parentid[body])
    while carrier and not model.body_jntnum[carrier] and claims(str(model.body(carrier).name)):
        carrier = int(model.body_parentid[carrier])
    T_LC = invert(points.pose(body)) @ points.pose(carrier)
    inside, own = apply(T_LC, _inside(points, carrier)), points.own(body)
    shape = outline(own, inside, T_LC[:3, 3]) if len(own) else None
    if shape is None:
        return _single(name, "empty link" if not len(own) else "link", name, np.eye(4), inside)
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == body]
    solid = any(model.geom_contype[geom] or model.geom_conaffinity[geom] for geom in geoms)
    return replace(_fitted(name, "link with a shape", name, shape, wanted), solid=solid)


def _inside(points: LinkPoints, carrier: int) -> Array:
    """Points (n, 3) [m] inside the body that carries a pad, in its frame: of its shapes, or without any its
    centre of mass."""
    own, model = points.own(carrier), points.compiled
    return own if len(own) or model.body_mass[carrier] <= BOUND_MASS else model.body_ipos[carrier][None]


def _fitted(name: str, how: str, link: str, shape: Outline, wanted: Device | None) -> Pad:
    """A pad with an outline: the grid of the device whose pad has this size, otherwise one taxel."""
    place = finger(name)
    fit = _wanted(wanted, shape, place) if wanted else None
    for one in (shape, shape.turned()):
        found = best_fit([one.size], place)
        if fit is None and found is not None and wanted in (None, found[0]):
            fit = found[0], found[1], one
    if fit is None:
        return _pad(name, how, link, _grid(1, 1, shape.size, shape.T_LP), thickness=shape.thickness)
    owner, pad, one = fit
    T_LP = one.T_LP
    if pad.from_last_row:
        T_LP = T_LP @ transform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    grid = _grid(pad.rows, pad.columns, one.size, T_LP, order=pad.order, mirrored=pad.from_last_row)
    side = next((side for side in ("left", "right") if side in name.lower()), "")
    own = [word for word in (side, place, pad.name) if word]
    title = "_".join(dict.fromkeys(own)) if place else name
    made = _pad(name, how, link, grid, thickness=shape.thickness)
    return replace(made, name=title, device=owner)


def _wanted(wanted: Device, shape: Outline, place: str | None) -> tuple[Device, DevicePad, Outline] | None:
    """The pad of a device whose proportions fit best, whatever its size."""
    fits = [
        (abs(np.log(one.size[0] / one.size[1] * pad.columns / pad.rows)), index, pad, one)
        for index, pad in enumerate(wanted.pads)
        if not pad.fingers or place in pad.fingers
        for one in (shape, shape.turned())
        if pad.size is None
    ]
    if not fits:
        return None
    _, _, pad, one = min(fits, key=lambda row: row[:2])
    return wanted, pad, one


def _grid(
    rows: int, columns: int, size: tuple[float, float], T_LP: Array, *,
    order: Literal["row-major", "column-major"] = "row-major", mirrored: bool = False,
) -> Grid:  # fmt: skip
    x, y, z = (round(float(value), 6) for value in T_LP[:3, 3])
    roll, pitch, yaw = (round(angle, 9) for angle in rpy_of(T_LP[:3, :3]))
    return Grid(
        rows=rows, columns=columns, length=round(size[0], 6), width=round(size[1], 6), order=order,
        mirrored=mirrored, origin=(x, y, z), rpy=(roll, pitch, yaw),
    )  # fmt: skip


def _pad(name: str, how: str, link: str, grid: Grid, *, thickness: float = 0.0) -> Pad:
    positions, normals, _ = grid_taxels(grid)
    return Pad(name, how, link, (name,), positions, normals, grid, thickness=thickness)


def _single(name: str, how: str, link: str, T_LP: Array, inside: Array) -> Pad:
    """One taxel whose size nobody knows."""
    z = best_axis(T_LP, inside)
    x = np.cross(z, T_LP[:3, int(np.argmin(np.abs(z @ T_LP[:3, :3])))])
    x /= np.linalg.norm(x)
    pose = transform(np.column_stack([x, np.cross(z, x), z]), T_LP[:3, 3])
    return _pad(name, how, link, _grid(1, 1, (SMALL, SMALL), pose))


def _sensors(search: _Search) -> None:
    """Touch sensors of MuJoCo, the sites that they use, and sites that only sound like touch."""
    spec = load_spec(search.model)
    kinds, used = mujoco.mjtSensor, set()
    for sensor in spec.sensors:
        name = sensor.name or sensor.objname
        on_site = sensor.objtype == mujoco.mjtObj.mjOBJ_SITE
        plugin = sensor.plugin.plugin_name if sensor.type == kinds.mjSENS_PLUGIN else ""
        if sensor.type == kinds.mjSENS_TOUCH or plugin.endswith("touch_grid"):
            used.add(sensor.objname)
            search.pads.append(_of_site(search, sensor, name, grid=bool(plugin)))
        elif sensor.type == kinds.mjSENS_TACTILE:
            search.pads.append(_of_mesh(search, sensor, name))
        elif sensor.type == kinds.mjSENS_CONTACT and on_site and claims(sensor.objname):
            used.add(sensor.objname)
            search.pads.append(_of_site(search, sensor, name, grid=False))
        elif sensor.type == kinds.mjSENS_CONTACT:
            search.leave("a contact sensor of whole shapes (feet, self-collision), no skin", name)
        elif sensor.type == kinds.mjSENS_RANGEFINDER:
            search.leave("a range finder: it measures distance", name)
    for site in spec.sites:
        if site.name not in used and claims(site.name):
            search.leave("a site that no touch sensor uses", site.name)
    for geom in spec.geoms:
        if offers(geom.name) and not offers(geom.parent.name):
            search.leave("a surface, of which nothing says that it feels: take it with --also", geom.name)


def _of_site(search: _Search, sensor: mujoco.MjsSensor, name: str, *, grid: bool) -> Pad:
    model, points = search.points.compiled, search.points
    site = model.site(sensor.objname)
    body = int(model.site_bodyid[site.id])
    link, inside = str(model.body(body).name), points.own(body)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, site.quat)
    T_LS = transform(rotation.reshape(3, 3), np.array(site.pos))
    half = np.array(site.size, float)
    half[half <= 0.0] = half[0]  # a sphere gives one number, a capsule two
    if grid:
        rows, columns = (int(count) for count in sensor.plugin.config["size"].split()[::-1])
        x, y, z = T_LS[:3, :3].T
        # The plugin looks along the site's -z and has no physical size: the grid lies on the site.
        pose = transform(np.column_stack([x, -y, -z]), T_LS[:3, 3])
        size = 2.0 * float(half[1]), 2.0 * float(half[0])
        return _pad(name, "site of a touch_grid", link, _grid(rows, columns, size, pose))
    how = f"site of a <{'touch' if sensor.type == mujoco.mjtSensor.mjSENS_TOUCH else 'contact'}>"
    thin = int(np.argmin(half))
    flat = half[thin] < 0.5 * np.sort(half)[1]
    if flat:
        normal = outward(T_LS[:3, thin], T_LS[:3, 3], inside, 2.0 * float(half.max()))
    else:
        normal = best_axis(T_LS, inside)
        thin = int(np.argmax(np.abs(normal @ T_LS[:3, :3])))
    first, second = (one for one in range(3) if one != thin)
    x = T_LS[:3, first]
    pose = transform(np.column_stack([x, np.cross(normal, x), normal]), T_LS[:3, 3] + half[thin] * normal)
    size = 2.0 * float(half[first]), 2.0 * float(half[second])
    found = _pad(name, how, link, _grid(1, 1, size, pose), thickness=2.0 * float(half[thin]))
    return replace(found, solid=bool(len(inside)))


def _of_mesh(search: _Search, sensor: mujoco.MjsSensor, name: str) -> Pad:
    """MuJoCo's `<tactile>`: its taxels are the vertices of a mesh, in the frame of a geom."""
    model = search.points.compiled
    index = model.sensor(sensor.name).id
    geom, mesh = model.geom(int(model.sensor_refid[index])), model.mesh(int(model.sensor_objid[index]))
    body = int(model.geom_bodyid[geom.id])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, geom.quat)
    T_LG = transform(rotation.reshape(3, 3), np.array(geom.pos))
    first, count = int(model.mesh_vertadr[mesh.id]), int(model.mesh_vertnum[mesh.id])
    positions = apply(T_LG, model.mesh_vert[first : first + count].astype(float))
    outer = positions - positions.mean(axis=0)
    outer /= np.maximum(np.linalg.norm(outer, axis=1, keepdims=True), 1e-9)
    return Pad(name, "<tactile> on a mesh", str(model.body(body).name), (name,), positions, outer)


def _of_ros(search: _Search, root: etree._Element) -> None:
    named = [one for one in root.iterfind("{*}sensor") if one.find("{*}tactile") is not None]
    if not named or search.model.format != "urdf":
        return
    try:
        sensors = read_tactile_sensors(search.model.path)
    except DescriptionError as error:
        search.notes += [f"<sensor><tactile> without taxels, since {fault}" for fault in error.faults]
        for one in named:
            parent = one.find("{*}parent")
            name, link = one.get("name", "?"), "?" if parent is None else parent.get("link", "?")
            none = np.zeros((0, 3))
            search.pads.append(Pad(name, "<sensor><tactile> with a fault", link, (name,), none, none))
        return
    for sensor in sensors:
        rows, layout = sensor.layout.taxels, sensor.layout
        search.pads.append(
            Pad(
                sensor.name, "<sensor><tactile>", sensor.link, (sensor.name,), layout.positions[rows],
                layout.normals[rows],
            )
        )  # fmt: skip


def _of_gazebo(search: _Search, root: etree._Element) -> None:
    for sensor in root.iter("sensor"):
        above = sensor.getparent()
        if sensor.get("type") in ("contact", "touch") and above is not None:
            where = above.get("reference") or above.get("name") or "?"
            search.leave("a contact sensor of Gazebo: a whole link, no pad", sensor.get("name") or str(where))


def _arrays(search: _Search) -> list[Pad]:
    """Joins the triangular modules of an iCub, and the taxels of its fingertips, which differ only in a
    running number. Others stay as they are."""
    groups: dict[str, list[Pad]] = {}
    for pad in search.pads:
        name, number = stem(pad.name)
        single = pad.how == "empty link" and number is not None and name.lower().endswith(SKIN_MODULE)
        groups.setdefault(name if single else f"={pad.name}/{id(pad)}", []).append(pad)
    joined = []
    for name, found in groups.items():
        if len(found) < 2:
            joined += found
            continue
        found.sort(key=lambda pad: stem(pad.name)[1] or 0)
        joined.append(_array(search.points, name, tuple(pad.name for pad in found), found[0]))
    return joined


def _array(points: LinkPoints, name: str, frames: tuple[str, ...], first: Pad) -> Pad:
    """One pad of the links `frames`: modules, or taxels if they are too near to each other for that."""
    bodies = [int(points.compiled.body(frame).id) for frame in frames]
    T_FR = invert(points.pose(bodies[0]))
    poses = T_FR @ np.array([points.pose(body) for body in bodies])
    places = poses[:, :3, 3]
    between = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(len(frames), 1)]
    if between.min() >= APART:
        return replace(first, name=name, how="array of triangular modules", members=frames, modules=frames)
    carrier = int(points.compiled.body_parentid[bodies[0]])
    normals = _normals(poses, apply(T_FR @ points.pose(carrier), _inside(points, carrier)))
    return Pad(name, "array of empty links, one taxel each", first.link, frames, places, normals)


def _normals(poses: Array, inside: Array) -> Array:
    """Normals (n, 3) of taxels whose frames `poses` (n, 4, 4) are all meant alike: the axis that points away
    from the nearest of the shapes' points `inside` (m, 3), and along which neighbours lie least."""
    places, turns = poses[:, :3, 3], poses[:, :3, :3]
    nearest = np.argsort(np.linalg.norm(places[:, None] - places, axis=2), axis=1)[:, 1:4]
    neighbours = np.einsum("nij,nki->nkj", turns, places[nearest] - places[:, None])
    depth = np.abs(neighbours).sum(axis=(0, 1))
    off = places - places.mean(axis=0)
    if len(inside):
        order = np.argsort(np.linalg.norm(places[:, None] - inside, axis=2), axis=1)
        off = places - inside[order[:, : len(inside) // 4 + 1]].mean(axis=1)
    away = np.einsum("nij,ni->j", turns, off)
    score = np.abs(away) / np.linalg.norm(away) - depth / depth.sum()
    axis = int(np.argmax(score))
    return np.array(turns[:, :, axis] * (1.0 if away[axis] >= 0.0 else -1.0))


def _named(pads: Iterable[Pad]) -> list[Pad]:
    found: dict[str, Pad] = {}
    for pad in pads:
        name = plain = re.sub(r"\W+", "_", pad.name).strip("_")
        while name in found:
            name = f"{plain}_{len(found)}"
        found[name] = replace(pad, name=name)
    return list(found.values())
