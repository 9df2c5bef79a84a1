"""A robot's kinematic model, MJCF or URDF, as a MuJoCo specification that can still be changed."""

from __future__ import annotations

from pathlib import Path

import mujoco
from lxml import etree

from tci.errors import DescriptionError, Fault
from tci.model.description import Model

_PACKAGE = "package://"


def load_spec(model: Model) -> mujoco.MjSpec:
    """The model as an editable specification, with a fixed base and every link a body.

    Visual geoms stay, and so do links without mass: the frames of skin modules are such links.
    Raises DescriptionError when the file is missing or MuJoCo can't read it.
    """
    path = Path(model.path)
    if not path.is_file():
        raise DescriptionError(model.path, [Fault(0, "no such file; a kinematic model belongs here")])
    try:
        if model.format == "urdf":
            spec = mujoco.MjSpec.from_string(_urdf_for_mujoco(path))
            for mesh in spec.meshes:  # a URDF says its masses, and MuJoCo refuses flat meshes otherwise
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        else:
            spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, etree.XMLSyntaxError) as error:
        raise DescriptionError(
            model.path, [Fault(0, f"not a readable {model.format} model: {error}")]
        ) from error
    # MuJoCo discards visual geoms twice, when it parses and again when it compiles.
    spec.compiler.discardvisual = False
    spec.compiler.fusestatic = False
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    return spec


def _urdf_for_mujoco(path: Path) -> str:
    """Text of a URDF with absolute mesh files, and with the settings that MuJoCo needs at parsing."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    root = etree.parse(str(path), parser).getroot()
    for mesh in root.iter("mesh"):
        if filename := mesh.get("filename"):
            mesh.set("filename", str(_mesh_file(path, filename)))
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
    return str(etree.tostring(root, encoding="unicode"))


def _mesh_file(urdf: Path, filename: str) -> Path:
    """Where a mesh lies. A `package://` is a folder of that name beside one of the URDF's parents."""
    if not filename.startswith(_PACKAGE):
        return (urdf.parent / filename.removeprefix("file://")).resolve()
    relative = filename.removeprefix(_PACKAGE).lstrip("/")  # some write package:///
    for folder in urdf.resolve().parents:
        if (folder / relative).is_file():
            return folder / relative
    package = relative.split("/", 1)[0]
    message = f"{filename}: no folder {package!r} with this file above {urdf.parent}"
    raise DescriptionError(str(urdf), [Fault(0, message)])
