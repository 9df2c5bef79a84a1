"""The robot's kinematic model, MJCF or URDF, as an editable MuJoCo specification."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml import etree

from tci.engine import mujoco
from tci.errors import DescriptionError, Fault
from tci.robot.description import Model
from tci.robot.mesh_files import binary_stl, is_readable

_PACKAGE = "package://"
SMALLEST = 1e-12
"""Smallest principal moment of inertia [kg m2] that counts as real. Assumed: that of a gram at a millimetre
is 1e-9, so smaller values are placeholders."""
LEAST_MASS, LEAST_INERTIA = 1e-3, 1e-6
"""Mass [kg] and moment of inertia [kg m2] of a moving link whose file gives no possible value. Assumed:
MuJoCo needs values above 0, and these are small beside a robot's real links."""


def load_spec(model: Model) -> mujoco.MjSpec:
    """Loads the model as an editable specification, with a fixed base and every link a named body.

    Visual geoms are kept, and so are links without mass: the frames of skin modules are such links. Raises
    DescriptionError when the file is missing or MuJoCo can't read it.
    """
    path = Path(model.path)
    if not path.is_file():
        raise DescriptionError(
            model.path, [Fault(0, "no such file; valid: a kinematic model (URDF or MJCF)")]
        )
    try:
        if model.format == "urdf":
            spec = _read_urdf(path)
            _mend_masses(spec)
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, etree.XMLSyntaxError) as error:
        raise DescriptionError(
            model.path, [Fault(0, f"not a readable {model.format} model: {error}")]
        ) from error
    # MuJoCo discards visual geoms twice: when it parses and again when it compiles.
    spec.compiler.discardvisual = False
    spec.compiler.fusestatic = False
    for index, body in enumerate(spec.bodies):
        body.name = body.name or f"tci_body_{index}"
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    for key in spec.keys:  # keyframes of a floating base, and of whatever else a scene contains
        spec.delete(key)
    return spec


def compile_once(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compiles a specification; MuJoCo keeps no copy of its meshes, which are 100 MB for an iCub.

    Raises ValueError.
    """
    cache = mujoco.mj_getCache()
    capacity = mujoco.mj_getCacheCapacity(cache)
    mujoco.mj_setCacheCapacity(cache, 0)
    try:
        return spec.compile()
    finally:
        mujoco.mj_setCacheCapacity(cache, capacity)


def compiled(spec: mujoco.MjSpec, model: Model) -> mujoco.MjModel:
    """Compiles the specification of a model.

    Raises DescriptionError for faults that MuJoCo finds only now, such as a missing mesh or an axis of length
    0, and for positions and axes that are not finite numbers.
    """
    try:
        made = compile_once(spec)
    except ValueError as error:
        raise DescriptionError(model.path, [Fault(0, f"not a usable model: {error}")]) from error
    places = (made.body_pos, made.body_quat, made.jnt_pos, made.jnt_axis, made.qpos0)
    if not all(np.isfinite(values).all() for values in places):
        raise DescriptionError(
            model.path, [Fault(0, "not a usable model: it holds numbers that are not finite")]
        )
    return made


def _read_urdf(path: Path) -> mujoco.MjSpec:
    """Reads a URDF: finds and converts its meshes, and sets the options that MuJoCo needs at parsing."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    root = etree.parse(str(path), parser).getroot()
    converted: dict[str, bytes] = {}
    for mesh in root.iter("mesh"):
        if filename := mesh.get("filename"):
            file = _mesh_file(path, filename)
            if not is_readable(file):
                file = Path(str(file).lstrip("/").replace("/", "_")).with_suffix(".stl")
                if file.name not in converted:
                    converted[file.name] = binary_stl(_mesh_file(path, filename))
            mesh.set("filename", str(file))
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
    return mujoco.MjSpec.from_string(str(etree.tostring(root, encoding="unicode")), assets=converted)


def _mend_masses(spec: mujoco.MjSpec) -> None:
    """Corrects data that URDFs contain and MuJoCo refuses: flat meshes, moving links without mass, impossible
    inertias."""
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
        if body.joints and not body.mass > 0.0 and (body.explicitinertial or not body.geoms):
            body.fullinertia = np.full(6, np.nan)
            body.mass, body.inertia, body.explicitinertial = LEAST_MASS, [LEAST_INERTIA] * 3, True


def _mesh_file(urdf: Path, filename: str) -> Path:
    """Returns the path of a mesh. `package://` names a folder next to one of the URDF's parents."""
    if not filename.startswith(_PACKAGE):
        file = (urdf.parent / filename.removeprefix("file://")).resolve()
        if not file.is_file():
            raise DescriptionError(str(urdf), [Fault(0, f"mesh {filename}: {file} is not a file")])
        return file
    relative = filename.removeprefix(_PACKAGE).lstrip("/")  # some write package:///
    for folder in urdf.resolve().parents:
        if (folder / relative).is_file():
            return folder / relative
    package = relative.split("/", 1)[0]
    message = f"{filename}: no folder {package!r} with this file above {urdf.parent}"
    raise DescriptionError(str(urdf), [Fault(0, message)])
