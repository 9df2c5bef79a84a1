"""The kinematic model of a robot, from an MJCF or URDF file, as an editable MuJoCo specification."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
from lxml import etree

from tci.errors import DescriptionError, Fault
from tci.messages.frames import rotation_rpy
from tci.robot.description import Attachment, Model
from tci.robot.mesh_files import NO_MESHES, VALID_MESHES, MeshFiles
from tci.support.engine import mujoco

SMALLEST = 1e-12
"""Principal moment of inertia [kg m2] below which a value is a placeholder. Assumed: one gram at a distance
of one millimetre has 1e-9 kg m2, so smaller values are not real."""
LEAST_MASS, LEAST_INERTIA = 1e-3, 1e-6
"""Mass [kg] and moment of inertia [kg m2] that a moving link gets if the values in its file are missing or 0.
Assumed: MuJoCo needs values above 0, and these values are small compared with those of real links."""
ASSUMED = "mass assumed"
"""Mark of such a link in the specification (`MjsBody.info`)."""

BOUND_MASS, BOUND_INERTIA = 1e-6, 1e-9
"""Least mass [kg] and moment of inertia [kg m2] of moving links without geoms. MuJoCo can't compile these
links without mass. These values are only used for kinematics, which do not depend on mass."""

_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_CAMERA = mujoco.mjtObj.mjOBJ_CAMERA


def load_spec(model: Model) -> mujoco.MjSpec:
    """Loads the model as an editable specification. The base is fixed, and every link is a body with a name.

    Visual geoms are kept. Links without mass, such as the frames of skin modules, are kept too. The world of
    an MJCF is left out (`world_of`), and what its geoms weigh is written as inertias. Raises
    DescriptionError if the file is missing or MuJoCo can't read it.
    """
    path = Path(model.path)
    if not path.is_file():
        raise DescriptionError(
            model.path, [Fault(0, "no such file; valid: a kinematic model (URDF or MJCF)")]
        )
    try:
        if model.format == "urdf":
            spec = _read_urdf(model)
            _drop_inferred_masses(spec)
            _mend_inertia(spec)
        else:
            spec = _read_mjcf(model)
            strip_world(spec)
        _mend_masses(spec)
    except (ValueError, etree.XMLSyntaxError) as error:
        words = " ".join(str(error).split())
        valid = "a file that MuJoCo reads"
        if "repeated name" in words:
            valid = "names of their own: rename or remove the element in that line, then try again"
        message = f"not a readable {model.format} model: {words}; valid: {valid}"
        raise DescriptionError(model.path, [Fault(0, message)]) from error
    if model.format == "mjcf" and _shapes_weigh(spec):
        _set_inertias(spec, model)
    for attachment in model.attachments:
        _attach(spec, attachment)
    # MuJoCo discards visual geoms twice: when it parses and again when it compiles.
    spec.compiler.discardvisual = False
    spec.compiler.fusestatic = False
    _name_bodies(spec)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    # Keyframes of a floating base, and contacts with a floor, belong to whatever scene contains the robot.
    for element in [*spec.keys, *spec.pairs]:
        spec.delete(element)
    return spec


def _name_bodies(spec: mujoco.MjSpec) -> None:
    for index, body in enumerate(spec.bodies):
        body.name = body.name or f"tci_body_{index}"


def world_of(model: Model) -> list[str]:
    """What `load_spec` leaves out of an MJCF, by kind and name; empty for a URDF, which has no world."""
    return strip_world(_read_mjcf(model)) if model.format == "mjcf" else []


def strip_world(spec: mujoco.MjSpec) -> list[str]:
    """Removes the scene around the robot: planes and height fields, things that float beside it, lights, the
    world's cameras. Returns what is gone, by kind and name.

    If the robot's base floats, all other shapes on the world go too. If it is fixed, they stay: MuJoCo itself
    writes the shapes of a fixed base as geoms of the world.
    """
    _name_bodies(spec)  # before bodies go, so that the numbers are those of the file
    tops = list(spec.worldbody.bodies)
    robots = [body for body in tops if any(joint.type in _ONE_AXIS for joint in _joints_under(body))]
    floats = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for body in robots for joint in body.joints)
    things = [
        body for body in tops if robots and body not in robots and (floats or body.mocap or body.joints)
    ]
    gone = [f"body {body.name}" for body in things]
    for body in things:
        spec.delete(body)
    endless = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    geoms = [geom for geom in spec.geoms if geom.type in endless or (floats and geom.parent.name == "world")]
    cameras = [one for one in spec.cameras if one.parent.name == "world" or one.targetbody]
    lost = {(kind, one.name) for kind, group in ((mujoco.mjtObj.mjOBJ_GEOM, geoms), (_CAMERA, cameras))
            for one in group if one.name}  # fmt: skip
    for sensor in list(spec.sensors):
        if {(sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)} & lost:
            spec.delete(sensor)
    gone += [f"geom {geom.name or geom.type.name.removeprefix('mjGEOM_').lower()}" for geom in geoms]
    for element in [*geoms, *cameras, *spec.lights, *spec.flexes, *spec.skins]:
        spec.delete(element)
    return gone


def _joints_under(body: mujoco.MjsBody) -> Iterator[mujoco.MjsJoint]:
    yield from body.joints
    for child in body.bodies:
        yield from _joints_under(child)


def _shapes_weigh(spec: mujoco.MjSpec) -> bool:
    """True if MuJoCo takes a mass from geoms, or scales the masses (`settotalmass`)."""
    always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    return spec.compiler.settotalmass > 0.0 or any(
        geom.mass != 0.0 and geom.density
        for body in spec.bodies if always or not body.explicitinertial for geom in body.geoms
    )  # fmt: skip


def _set_inertias(spec: mujoco.MjSpec, model: Model) -> None:
    """Writes the masses that MuJoCo computes from the geoms into the links, so that a model has the same
    masses with and without its shapes. Nothing happens if MuJoCo can't compile the model: who needs the
    masses then names the links that lack them."""
    try:
        made = _with_masses(model, Path(model.path).stat().st_mtime_ns)
    except (ValueError, DescriptionError):
        return
    roots = set(made.body_rootid[made.jnt_bodyid])  # a table beside the robot weighs nothing
    for body in spec.bodies[1:]:
        own = made.body(body.name)
        if own.rootid[0] in roots and (own.mass[0] > 0.0 or body.joints):
            body.mass, body.ipos, body.iquat = float(own.mass[0]), own.ipos, own.iquat
            body.fullinertia, body.inertia, body.explicitinertial = [np.nan] * 6, own.inertia, True
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    spec.compiler.settotalmass = -1.0


@lru_cache(maxsize=16)
def _with_masses(model: Model, _: int) -> mujoco.MjModel:
    """MuJoCo's own form of an MJCF, world and all, since `settotalmass` counts that too. The second argument
    is the time [ns] at which the file was last written."""
    spec = _read_mjcf(model)
    _name_bodies(spec)
    _mend_masses(spec)
    _place_meshes(spec, model)
    return compile_once(spec)


def compile_once(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compiles a specification, but does not keep MuJoCo's copy of the meshes, which needs 100 MB for an
    iCub.

    Raises ValueError if MuJoCo can't compile the specification.
    """
    cache = mujoco.mj_getCache()
    capacity = mujoco.mj_getCacheCapacity(cache)
    mujoco.mj_setCacheCapacity(cache, 0)
    try:
        return spec.compile()
    finally:
        mujoco.mj_setCacheCapacity(cache, capacity)


def _attach(spec: mujoco.MjSpec, attachment: Attachment) -> None:
    """Fixes another model to a link of the model `spec`. `attachment` names the file of the other model, the
    link, and the pose on this link. Raises DescriptionError if the file can't be read."""
    try:
        other = mujoco.MjSpec.from_file(attachment.path)
    except ValueError as error:
        raise DescriptionError(attachment.path, [Fault(0, f"not a readable mjcf model: {error}")]) from error
    # What its elements mean depends on the file that they are in, so both files get the same settings.
    other.compiler.degree = spec.compiler.degree
    other.compiler.boundmass, other.compiler.boundinertia = BOUND_MASS, BOUND_INERTIA
    if attachment.replaces is not None:
        gone = spec.body(attachment.replaces)
        for geom in list(gone.geoms):
            spec.delete(geom)
        gone.mass, gone.inertia, gone.fullinertia = 0.0, [0.0] * 3, [np.nan] * 6
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation_rpy(*attachment.rpy).ravel())
    frame = spec.body(attachment.link).add_frame(pos=attachment.xyz, quat=quaternion)
    spec.attach(other, frame=frame, prefix=attachment.prefix)


def compiled(spec: mujoco.MjSpec, model: Model) -> mujoco.MjModel:
    """Compiles the specification of a model.

    Raises DescriptionError for faults that MuJoCo finds only when it compiles, such as a missing mesh or an
    axis of length 0. Also raises it if a position or an axis is not finite.
    """
    if model.format == "mjcf":
        _place_meshes(spec, model)
    try:
        made = compile_once(spec)
    except ValueError as error:
        message = f"not a usable model: {error}{_flat(spec)}"
        if _is_of_a_mesh(error, spec):
            message += f"; {VALID_MESHES}"
        raise DescriptionError(model.path, [Fault(0, message)]) from error
    places = (made.body_pos, made.body_quat, made.jnt_pos, made.jnt_axis, made.qpos0)
    if not all(np.isfinite(values).all() for values in places):
        raise DescriptionError(
            model.path, [Fault(0, "not a usable model: it holds numbers that are not finite")]
        )
    return made


def _read_urdf(model: Model) -> mujoco.MjSpec:
    """Reads a URDF file as a MuJoCo specification, with meshes converted to a format that MuJoCo reads.
    Raises DescriptionError if a mesh is missing or broken."""
    path = Path(model.path)
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    root = etree.parse(str(path), parser).getroot()
    lines = "\n" * ((root.sourceline or 1) - 1)
    meshes = MeshFiles(path, model.meshes)
    converted: dict[str, bytes] = {}
    for shape in [shape for tag in ("visual", "collision") for shape in root.iter(tag)]:
        left_out = _is_point(shape)  # MuJoCo refuses it
        for mesh in shape.iter("mesh"):
            if model.meshes == NO_MESHES:
                left_out = True
            elif (name := mesh.get("filename")) and (file := meshes.find(str(name))) is not None:
                mesh.set("filename", meshes.readable(file, converted))
        if left_out:
            _cut(shape)
    meshes.check()
    for element in root.iter("origin", "axis"):
        for name in ("xyz", "rpy"):
            if "," in element.get(name, ""):  # readers of ROS take it for a blank, MuJoCo refuses it
                element.set(name, element.get(name, "").replace(",", " "))
    for extension in root.findall("mujoco"):
        root.remove(extension)
    extension = etree.SubElement(root, "mujoco")
    etree.SubElement(
        extension,
        "compiler",
        discardvisual="false",
        fusestatic="false",
        strippath="false",
        balanceinertia="true",
    )
    # Comments and the lines before the root are kept, so that lines in messages are those of the file.
    text = lines + str(etree.tostring(root, encoding="unicode"))
    return mujoco.MjSpec.from_string(text, assets=converted)


def _cut(shape: etree._Element) -> None:
    """Removes an element, but not its lines: those in messages are the file's."""
    gap, parent, before = "\n" * etree.tostring(shape).count(b"\n"), shape.getparent(), shape.getprevious()
    if before is None:
        parent.text = f"{parent.text or ''}{gap}"
    else:
        before.tail = f"{before.tail or ''}{gap}"
    parent.remove(shape)


def _is_point(shape: etree._Element) -> bool:
    """Returns True for a sphere, box or cylinder of size 0. Published models use these shapes to mark
    frames."""
    extents = [
        size for kind in ("sphere", "box", "cylinder") for one in shape.iterfind(f"geometry/{kind}")
        for key in ("radius", "length", "size") for size in one.get(key, "").split()
    ]  # fmt: skip
    return bool(extents) and all(re.fullmatch(r"[-+]?0*\.?0*", size) for size in extents)


def _read_mjcf(model: Model) -> mujoco.MjSpec:
    """Reads an MJCF file; if the model has the attribute meshes="none", without its meshes, and with
    radians="true", with its angles in radians."""
    path = Path(model.path)
    if path.suffix == ".xml":
        spec = mujoco.MjSpec.from_file(model.path)
    else:  # MuJoCo picks the decoder by the name, so a file.mjcf is lent one that it knows
        files, name = mujoco.MjVfs(), f"{model.path}.xml"
        files[name] = path.read_bytes()
        spec = mujoco.MjSpec.from_file(name, vfs=files)
    spec.compiler.degree = spec.compiler.degree and not model.radians
    shown = [geom for geom in spec.geoms if geom.meshname]
    if model.meshes == NO_MESHES:
        for element in [*shown, *spec.meshes]:
            spec.delete(element)
    return spec


def _place_meshes(spec: mujoco.MjSpec, model: Model) -> None:
    """Sets the mesh files of the specification of an MJCF model to files that exist and that MuJoCo reads.
    Raises DescriptionError if a mesh is missing or broken."""
    meshes = MeshFiles(Path(model.path), model.meshes)
    converted: dict[str, bytes] = {}
    for mesh in spec.meshes:
        if mesh.file and (file := meshes.find(str(Path(spec.meshdir, mesh.file)))) is not None:
            mesh.file = meshes.readable(file, converted)
    meshes.check()
    if converted:
        spec.meshdir, spec.assets = "", converted


def _drop_inferred_masses(spec: mujoco.MjSpec) -> None:
    """Sets the mass of fixed links without `<inertial>` to 0, as URDF defines it. A fixed link is a link
    without a joint. Otherwise MuJoCo would infer a mass from the geometry, which is only meant for collision.

    The inferred mass stays if the moving link that carries the fixed link has no `<inertial>` either, because
    the file then describes no masses. For a link that no joint moves, the inferred mass stays if the whole
    file has no `<inertial>`.
    """
    described = any(body.explicitinertial for body in spec.bodies)
    for body in spec.bodies:
        carrier = _carrier(body)
        known = described if carrier is None else carrier.explicitinertial
        if known and not body.explicitinertial and not body.joints:
            for geom in body.geoms:
                geom.mass = 0.0


def _carrier(body: mujoco.MjsBody) -> mujoco.MjsBody | None:
    """Returns the nearest link above `body` in the model that has a joint; None if no link above `body` has a
    joint."""
    above = body.parent
    while above is not None and above.name != "world" and not above.joints:
        above = above.parent
    return None if above is None or above.name == "world" else above


def _mend_inertia(spec: mujoco.MjSpec) -> None:
    """Corrects inertias that MuJoCo would refuse: those of flat meshes, and physically impossible ones in the
    file."""
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    for body in spec.bodies:
        full = np.array(body.fullinertia)
        if np.isfinite(full).all():
            xx, yy, zz, xy, xz, yz = full
            values, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if values[0] < SMALLEST:
                mended = axes @ np.diag(np.maximum(values, LEAST_INERTIA)) @ axes.T
                body.fullinertia = mended[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        elif body.joints and body.explicitinertial:
            body.inertia = np.maximum(body.inertia, SMALLEST)


def _mend_masses(spec: mujoco.MjSpec) -> None:
    """Gives a small mass to moving links without a mass, and marks them: links with an `<inertial>` of mass
    0, and links with neither `<inertial>` nor geometry. Raises ValueError for a mass that is no number."""
    for body in spec.bodies:
        if body.explicitinertial and not (np.isfinite(body.mass) and body.mass >= 0.0):
            raise ValueError(f"link {body.name}: mass {body.mass:g} kg; valid: a finite mass, at least 0 kg")
        if body.joints and not body.mass > 0.0 and (body.explicitinertial or not body.geoms):
            body.fullinertia = np.full(6, np.nan)
            body.mass, body.inertia, body.explicitinertial = LEAST_MASS, [LEAST_INERTIA] * 3, True
            body.info = ASSUMED


def assumed_masses(model: Model) -> list[str]:
    """Names of the moving links that got `LEAST_MASS`, since their file says no mass or 0."""
    spec = load_spec(model)  # its elements must not outlive it
    return [body.name for body in spec.bodies if body.info == ASSUMED]


def _is_of_a_mesh(error: ValueError, spec: mujoco.MjSpec) -> bool:
    """Returns True if the error that MuJoCo raised is about a mesh of the model."""
    named = re.search(r"Element name '(.*)'", str(error))
    return named is not None and named[1] in {mesh.name for mesh in spec.meshes}


def _flat(spec: mujoco.MjSpec) -> str:
    """Returns the end of a message that names the links with geometry of size 0; an empty text if there are
    none."""
    sized = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    links = [geom.parent.name for geom in spec.geoms if geom.type not in sized and not geom.size[0] > 0.0]
    return f" (the shape of {', '.join(dict.fromkeys(links))}; valid: above 0)" if links else ""
