"""The element `model`: reads the path of the kinematic model, and checks the links and joints that a
description names."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from lxml import etree

from tci.errors import DescriptionError
from tci.robot.description import Attachment, Model
from tci.robot.mesh_files import NO_MESHES
from tci.robot.xml.document import Faults, parse, read_bytes
from tci.robot.xml.node import Node, nearest

MAX_MODEL_BYTES = 16 << 20
"""Size [bytes] of the largest model file in which the names of links and joints are checked."""

_OPAQUE = ("include", "attach", "replicate")
"""Elements of an MJCF file that add links and joints whose names are not in the file. If a model has such an
element, the names of its links and joints are not checked."""

_ONE_AXIS = ("revolute", "continuous", "prismatic", "hinge", "slide")
"""Types of joints in URDF and MJCF that a servo can move."""
_SLIDES = ("prismatic", "slide")


@dataclass(frozen=True)
class ModelNames:
    """Names of links and joints that a description may use, because the model contains them."""

    links: frozenset[str]
    joints: frozenset[str]
    """All that a servo can move."""
    slides: frozenset[str]
    """Those of them that slide."""

    def with_prefixed(self, prefix: str, other: ModelNames) -> ModelNames:
        """Returns the names of this model, and the names of an attached model with `prefix` before each of
        them."""
        own, others = (self.links, self.joints, self.slides), (other.links, other.joints, other.slides)
        return ModelNames(
            *(mine | {prefix + name for name in o} for mine, o in zip(own, others, strict=True))
        )


def read_model(root: Node, source: Path, faults: Faults) -> tuple[Model | None, str | None]:
    """Returns the model that the description `source` names. If the model is in a package that is not
    installed, the second result is the name of this package; otherwise, it is None."""
    node = root.first("model")
    if node is None or not node.ok:
        return None, None
    package, file = node.get("package"), node.get("file")
    if "extra" in node.values and package is None:
        faults.add(
            node.line, "extra of <model> says which extra installs its package, but there is no package"
        )
    if package is None:
        path = beside(node, source, "model", faults)
    else:
        try:
            path = packaged(str(package), str(file))
        except PackageNotFoundError:
            return None, package
        if path is None:
            faults.add(
                node.line, f"the package {package!r} has no file {file!r}; valid: the end of a file's path"
            )
    if path is None:
        return None, None
    attachments = []
    names = _names(node, path, node.get("format"), faults)
    for child in node.all("attachment"):
        file = beside(child, source, "model", faults) if child.ok else None
        if file is None:
            continue
        attachments.append(Attachment(**child.fields | {"path": str(file)}))
        own = _names(child, file, "mjcf", faults)
        names = names.with_prefixed(child.get("prefix"), own) if names and own else None
    if names is not None:
        _check_names(root, names, faults)
    found = {"path": str(path), "meshes": _meshes(node, source, faults), "attachments": tuple(attachments)}
    return Model(**node.fields | found), None


def _meshes(node: Node, source: Path, faults: Faults) -> str | None:
    """Returns the path of the folder with meshes that `node` names, or "none" if the model is read without
    meshes. Records a fault if the folder is not in or below the folder of the description `source`."""
    meshes: str | None = node.get("meshes")
    if meshes is None or meshes == NO_MESHES:
        return meshes
    folder = source.absolute().parent.resolve()
    path = (folder / meshes).resolve()
    if not path.is_dir() or not path.is_relative_to(folder):
        faults.add(node.line, f"meshes {meshes!r} is no folder in {folder}; valid: one, or {NO_MESHES!r}")
        return None
    return str(path)


def beside(node: Node, source: Path, what: str, faults: Faults) -> Path | None:
    """Returns the file that `node` names. The file must be in the folder of the description `source` or below
    it, also after symbolic links are resolved."""
    file = node.get("file")
    if file is None:
        return None
    folder = source.absolute().parent
    try:
        path: Path = (folder / file).resolve()
        # Some installers replace each file of a package by a link to a central store.
        homes = folder.resolve(), source.resolve().parent
        if not path.is_file():
            faults.add(node.line, f"{what} file {file!r} is not a file in {folder}")
        elif not any(path.is_relative_to(home) for home in homes):
            faults.add(node.line, f"{what} file {file!r} leads out of the folder of the description")
        else:
            return path
    except OSError as error:
        faults.add(node.line, f"{what} file {file!r} can't be reached: {error.strerror}")
    return None


def packaged(package: str, file: str) -> Path | None:
    """Returns the path of a package's installed file whose path ends in `file`; None if the package has no
    such file.

    Raises PackageNotFoundError if the package is not installed.
    """
    steps = tuple(file.split("/"))
    installed = distribution(package)
    for entry in installed.files or ():
        if entry.parts[-len(steps) :] == steps:
            found = Path(str(installed.locate_file(entry))).resolve()
            if found.is_file():
                return found
    # Some packagers (conda, Debian) don't list the files that they install below share/.
    shared = Path(sys.prefix, "share", *steps)
    return shared if shared.is_file() else None


def _names(node: Node, path: Path, format: str, faults: Faults) -> ModelNames | None:
    try:
        root = parse(read_bytes(path, limit=MAX_MODEL_BYTES), str(path))
    except DescriptionError as error:
        for fault in error.faults:
            faults.add(node.line, f"model file {path.name}: {fault}")
        return None
    top = {"urdf": "robot", "mjcf": "mujoco"}[format]
    if root.tag != top:
        faults.add(
            node.line, f"model file {path.name} starts with <{root.tag}>; a {format} file with <{top}>"
        )
        return None
    if any(True for _ in root.iter(*_OPAQUE)):
        return None
    links, joints = ("link", "joint") if format == "urdf" else ("worldbody//body", "worldbody//joint")
    usual = {"urdf": "", "mjcf": "hinge"}[format]
    moving = [joint for joint in root.iterfind(joints) if joint.get("type", usual) in _ONE_AXIS]
    slides = [joint for joint in moving if joint.get("type") in _SLIDES]
    # The name `world` is no link, even if the root of a URDF has this name, because the world is no valid
    # reference frame.
    return ModelNames(
        frozenset(_attribute(root.iterfind(links))) - {"world"}, frozenset(_attribute(moving)),
        frozenset(_attribute(slides)),
    )  # fmt: skip


def _attribute(elements: Iterable[etree._Element]) -> list[str]:
    return [str(element.get("name")) for element in elements if element.get("name")]


def _check_names(root: Node, names: ModelNames, faults: Faults) -> None:
    """Records a fault for each link, joint or frame that the description names but the model does not
    contain."""

    def check(node: Node | None, attribute: str, valid: frozenset[str], what: str) -> None:
        name = None if node is None else node.get(attribute)
        if node is not None and name is not None and name not in valid:
            faults.add(node.line, f"the model has no {what} {name!r}{nearest(name, sorted(valid))}")

    model = root.first("model")
    check(model, "torso_link", names.links, "link")
    for attachment in model.all("attachment") if model is not None else ():
        check(attachment, "link", names.links, "link")
        check(attachment, "replaces", names.links, "link")
    for part in root.all("robot_part"):
        for servo in part.all("servo"):
            check(servo, "joint", names.joints, "moving joint")
            for node in servo.all("mimic"):
                check(node, "joint", names.joints, "moving joint")
                if node.get("joint") in names.slides:
                    valid = f'valid: <slide joint="{node.get("joint")}" radius="..."/> [m per rad]'
                    faults.add(node.line, f"the joint {node.get('joint')!r} slides and can't turn; {valid}")
            for node in servo.all("slide"):
                check(node, "joint", names.slides, "sliding joint")
    for generic in root.all("generic_robot_part"):
        for node in (*generic.all("segment"), *generic.all("cartesian_actuator"), *generic.all("eyes")):
            check(node, "link", names.links, "link")
    skin = root.first("skin")
    for patch in skin.all("patch") if skin is not None else ():
        check(patch, "link", names.links, "link")
        for modules in patch.all("triangular_modules"):
            for module in modules.all("module"):
                check(module, "frame", names.links, "link")
