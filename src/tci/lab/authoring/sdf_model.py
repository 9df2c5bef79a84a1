"""An SDF model as URDF, as far as pads need it: links, joints, poses, masses and shapes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml import etree
from lxml.builder import E

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array, invert, rotation_rpy, rpy_of, transform

_AXIAL = ("revolute", "continuous", "prismatic")


def sdf_as_urdf(path: Path, root: etree._Element) -> etree._Element:
    """The first model of an SDF file. Poses `relative_to` something else than the model or a link of it are
    refused, and so are nested models.

    Raises DescriptionError.
    """
    model = next(root.iter("model"), None)
    if model is None or model.find("model") is not None or model.find("include") is not None:
        message = "no single <model> without nested models; valid: what `gz sdf -p FILE` prints for one model"
        raise DescriptionError(str(path), [Fault(root.sourceline or 0, message)])
    places = _poses(model, path)
    joints = {joint.findtext("child", ""): joint for joint in model.iterfind("joint")}
    made = E.robot(name=model.get("name") or "model")
    made.append(E.link(name="sdf_model"))
    for link in model.iterfind("link"):
        name = str(link.get("name"))
        made.append(_link(link, path))
        joint = joints.get(name)
        parent = "sdf_model" if joint is None else joint.findtext("parent", "")
        parent = parent if parent in places else "sdf_model"
        kind = "fixed" if joint is None else str(joint.get("type"))
        axis = "0 0 1" if joint is None else joint.findtext("axis/xyz", "0 0 1")
        pose = invert(places[parent]) @ places[name]
        child = E.joint(
            _origin(pose), E.parent(link=parent), E.child(link=name), E.axis(xyz=axis),
            name=f"{name}_to_{parent}" if joint is None else str(joint.get("name")),
            type="continuous" if kind in _AXIAL else kind if kind == "fixed" else "continuous",
        )  # fmt: skip
        made.append(child)
    return made


def _poses(model: etree._Element, path: Path) -> dict[str, Array]:
    found: dict[str, Array] = {"sdf_model": np.eye(4)}
    waiting = list(model.iterfind("link"))
    while waiting:
        left = []
        for link in waiting:
            pose = link.find("pose")
            base = "" if pose is None else pose.get("relative_to", "")
            base = "sdf_model" if base in ("", "__model__", model.get("name")) else base
            if base in found:
                found[str(link.get("name"))] = found[base] @ _pose(pose)
            else:
                left.append(link)
        if len(left) == len(waiting):
            name = left[0].find("pose").get("relative_to")
            message = f"pose of {left[0].get('name')} is relative to {name!r}; valid: a link, or __model__"
            raise DescriptionError(str(path), [Fault(left[0].sourceline or 0, message)])
        waiting = left
    return found


def _pose(element: etree._Element | None) -> Array:
    numbers = [] if element is None or not element.text else [float(word) for word in element.text.split()]
    x, y, z, roll, pitch, yaw = (*numbers, *[0.0] * (6 - len(numbers)))
    return transform(rotation_rpy(roll, pitch, yaw), np.array([x, y, z]))


def _link(link: etree._Element, path: Path) -> etree._Element:
    made = E.link(name=str(link.get("name")))
    mass = link.findtext("inertial/mass")
    if mass is not None:
        inertia = {key: "1e-6" if key in ("ixx", "iyy", "izz") else "0" for key in
                   ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}  # fmt: skip
        made.append(E.inertial(E.mass(value=mass), E.inertia(**inertia)))
    for tag in ("visual", "collision"):
        for shape in link.iterfind(tag):
            geometry = _geometry(shape.find("geometry"), path)
            if geometry is not None:
                made.append(E(tag, _origin(_pose(shape.find("pose"))), E.geometry(geometry)))
    return made


def _geometry(geometry: etree._Element | None, path: Path) -> etree._Element | None:
    for shape in [] if geometry is None else geometry:
        text = {child.tag: (child.text or "").strip() for child in shape}
        if shape.tag == "box":
            return E.box(size=text["size"])
        if shape.tag == "sphere":
            return E.sphere(radius=text["radius"])
        if shape.tag in ("cylinder", "capsule"):
            return E.cylinder(radius=text["radius"], length=text["length"])
        if shape.tag == "mesh":
            return E.mesh(filename=_file(text.get("uri", ""), path), scale=text.get("scale", "1 1 1"))
    return None


def _file(uri: str, path: Path) -> str:
    """The absolute path of a mesh; `uri` itself if it isn't found, so that the message names it."""
    inside = uri.partition("://")[2] or uri
    places = [folder / inside for folder in path.resolve().parents]
    return next((str(place) for place in places if place.is_file()), uri)


def _origin(pose: Array) -> etree._Element:
    def words(values: Array) -> str:
        return " ".join(repr(float(value)) for value in values)

    return E.origin(xyz=words(pose[:3, 3]), rpy=words(np.array(rpy_of(pose[:3, :3]))))
