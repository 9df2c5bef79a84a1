"""Exports a robot's kinematic model as one URDF without meshes. The robot's model may be URDF or MJCF."""

from __future__ import annotations

import warnings

import numpy as np
from lxml import etree
from lxml.builder import E

from tci.errors import DescriptionError, Fault
from tci.exports.tree import KinematicLink, links_of
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot

TORSO = "tci_torso"
"""Name of the additional link, whose frame is the torso frame."""


def to_urdf(robot: RobotLike) -> str:
    """Returns URDF text with links, joints, inertias, and an additional link for the torso frame.

    The joints' names come from the model, and their limits come from the robot's description. A revolute
    joint without known limits becomes continuous. Raises DescriptionError if the robot has no model, and for
    joints that URDF can't express: a joint with an axis that does not pass through its link's origin, or a
    prismatic joint without limits.
    """
    robot = as_robot(robot)
    root = E.robot(name=robot.name)
    links = links_of(robot)
    roots = [link for link in links if not link.parent]
    if len(roots) > 1 or any(link.servo is not None for link in roots):
        root.append(E.link(name="world"))
    for link in links:
        root.append(_link(link))
    for link in links:
        if link.parent or len(root.findall("link[@name='world']")):
            root.append(_joint(robot, link, link.parent or "world"))
    assert robot.model is not None  # `links_of` raises an error for a robot without a model
    root.append(E.link(name=TORSO))
    root.append(
        E.joint(
            _origin(robot.model.T_LT),
            E.parent(link=robot.model.torso_link),
            E.child(link=TORSO),
            name=f"{TORSO}_joint",
            type="fixed",
        )
    )
    text: str = etree.tostring(root, pretty_print=True, encoding="unicode")
    return '<?xml version="1.0"?>\n' + text


def _link(link: KinematicLink) -> etree._Element:
    if link.inertia is None:
        return E.link(name=link.name)
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = link.inertia.tensor
    tensor = {"ixx": ixx, "ixy": ixy, "ixz": ixz, "iyy": iyy, "iyz": iyz, "izz": izz}
    return E.link(
        E.inertial(
            E.origin(xyz=_words(link.inertia.centre), rpy="0 0 0"),
            E.mass(value=repr(link.inertia.mass)),
            E.inertia(**{name: repr(value) for name, value in tensor.items()}),
        ),
        name=link.name,
    )


def _joint(robot: Robot, link: KinematicLink, parent: str) -> etree._Element:
    pose = np.array(link.pose)
    if link.servo is None:
        children = [_origin(pose), E.parent(link=parent), E.child(link=link.name)]
        return E.joint(*children, name=f"{link.name}_fixed", type="fixed")
    if any(link.anchor) and not link.slides:
        fault = f"the joint of {link.name} does not turn about its link's origin: no URDF can say so"
        raise DescriptionError(robot.source, [Fault(0, fault)])
    servo = robot.servos[link.servo]
    limits = servo.limits
    known = limits.lower is not None and limits.upper is not None
    if link.slides and not known:
        fault = f"the joint of {link.name} slides and has no limits: no URDF can say so"
        raise DescriptionError(robot.source, [Fault(0, fault)])
    children = [_origin(pose), E.parent(link=parent), E.child(link=link.name), E.axis(xyz=_words(link.axis))]
    if known:
        children.append(
            E.limit(
                lower=repr(limits.lower),
                upper=repr(limits.upper),
                velocity=repr(limits.velocity or 0.0),
                effort=repr(limits.torque or 0.0),
            )
        )
    kind = "prismatic" if link.slides else "revolute" if known else "continuous"
    return E.joint(*children, name=servo.joint or servo.name, type=kind)


def _origin(pose: Array) -> etree._Element:
    # A tenth of the start of a served robot, which writes no URDF.
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # at gimbal lock several results are equally valid
        rpy = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
    return E.origin(xyz=_words(pose[:3, 3]), rpy=_words(rpy))


def _words(values: Array | tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
