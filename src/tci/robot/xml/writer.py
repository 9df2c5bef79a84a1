"""A robot's description as XML text, in degrees: the inverse of `read_robot`."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap

import numpy as np
from lxml import etree

from tci.errors import TciError
from tci.robot.description import GenericPart, GenericServo, Patch, Robot, Servo, TruncatedCone

PLACES = 6
"""Number of decimals of an angle [degrees], and of a length [m]."""


def write_robot(robot: Robot, *, file: str, extra: str | None = None, comment: str = "") -> str:
    """Returns a robot's description as XML text.

    `file` is the model's path relative to the description, or the end of its path in the model's package,
    which `extra` installs. Raises TciError for content that is only written by hand: couplings, tables, skin
    that is no cone.
    """
    if robot.couplings:
        raise TciError("couplings are not written; add them by hand")
    root = etree.Element("generic_robot", version="1", name=robot.name, angle_unit="deg")
    if robot.title:
        root.set("title", robot.title)
    if comment:
        plain = comment.replace("--", "-")  # XML allows none in a comment
        lines = [line for part in plain.splitlines() for line in wrap(part, 105)]
        root.append(etree.Comment(" " + "\n     ".join(lines) + " "))
    if robot.model is not None:
        model = etree.SubElement(root, "model", format=robot.model.format, file=file)
        model.set("torso_link", robot.model.torso_link)
        if any(robot.model.torso_rpy):
            model.set("torso_rpy", " ".join(_degrees(angle) for angle in robot.model.torso_rpy))
        if any(robot.model.torso_xyz):
            model.set("torso_xyz", _metres(robot.model.torso_xyz))
        if robot.model.package is not None:
            model.set("package", robot.model.package)
        if extra is not None:
            model.set("extra", extra)
    for name in dict.fromkeys(servo.robot_part for servo in robot.servos):
        own = robot.servos_of(name)
        part = etree.SubElement(root, "robot_part", name=name, modes=" ".join(m.value for m in own[0].modes))
        for servo in own:
            _servo(part, servo)
    for generic in robot.parts:
        _part(root, robot, generic)
    if robot.patches:
        skin = etree.SubElement(root, "skin")
        for patch in robot.patches:
            _patch(skin, patch)
    for binding in robot.bindings:
        etree.SubElement(
            root, "binding", middleware=binding.middleware,
            rate=f"{binding.rate:g}", stale_after=f"{binding.stale_after:g}",
        )  # fmt: skip
    etree.indent(root)
    text: str = etree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _servo(part: etree._Element, servo: Servo) -> None:
    node = etree.SubElement(part, "servo", id=str(servo.id), name=servo.name)
    if servo.joint is not None:
        node.set("joint", servo.joint)
    limits = servo.limits

    def limit(name: str, ours: bool, **values: str) -> None:
        etree.SubElement(node, name, **values, **({"origin": "ours"} if ours else {}))

    if limits.lower is not None and limits.upper is not None:
        limit("position", "lower" in limits.ours, min=_degrees(limits.lower), max=_degrees(limits.upper))
    for name in ("velocity", "acceleration", "jerk"):
        if (value := getattr(limits, name)) is not None:
            limit(name, name in limits.ours, max=_degrees(value))
    if limits.torque is not None:
        limit("torque", "torque" in limits.ours, max=f"{limits.torque:g}")


def _part(root: etree._Element, robot: Robot, part: GenericPart) -> None:
    node = etree.SubElement(root, "generic_robot_part", name=part.name, kind=part.kind)
    if part.side is not None:
        node.set("side", part.side)
    homes = [robot.servos[s.servo].robot_part for s in part.servos if s.servo is not None]
    home = homes[0] if homes else robot.servos[0].robot_part
    node.set("robot_part", home)
    if any(part.mount):
        mount = etree.SubElement(node, "mount")
        for name, angle in zip(("roll", "pitch", "yaw"), part.mount, strict=True):
            mount.set(name, _degrees(angle))
    etree.SubElement(node, "generic_servo_number").text = str(len(part.servos))
    for servo in part.servos:
        _generic_servo(node, robot, home, servo)
    mapped = [servo for servo in part.servos if servo.servo is not None]
    if mapped:
        initial = etree.SubElement(node, "initial_positions")
        for servo in mapped:
            etree.SubElement(
                initial, "servo", destination_servo_id=str(servo.id), pos=_degrees(servo.initial)
            )
    for segment in part.segments:
        etree.SubElement(
            node, "segment", name=segment.name, link=segment.link,
            origin=_metres(segment.origin), length=f"{round(segment.length, PLACES):g}",
        )  # fmt: skip


def _generic_servo(part: etree._Element, robot: Robot, home: str, servo: GenericServo) -> None:
    node = etree.SubElement(part, "generic_servo", id=str(servo.id), name=servo.name)
    target = etree.SubElement(node, "destination_servo_id")
    if servo.servo is None:
        target.text = "none"
        etree.SubElement(node, "fixed_position").text = _degrees(servo.fixed)
        return
    own = robot.servos[servo.servo]
    target.text = str(own.id)
    if own.robot_part != home:
        target.set("robot_part", own.robot_part)
    if servo.transform not in ("linear", "retarget"):
        raise TciError(f"the transform {servo.transform} is not written; add it by hand")
    if servo.transform == "retarget":
        etree.SubElement(node, "transform_type").text = servo.transform
    else:
        etree.SubElement(node, "transform_factor").text = f"{servo.scale:.9g}"
        etree.SubElement(node, "transform_displacement").text = _degrees(servo.offset)
    if servo.speed is not None:
        etree.SubElement(node, "speed").text = _degrees(servo.speed)


def _patch(skin: etree._Element, patch: Patch) -> None:
    node = etree.SubElement(
        skin, "patch", name=patch.name, part=patch.part, segment=patch.segment, link=patch.link,
        rate=f"{patch.rate:g}", channels=str(patch.channels),
    )  # fmt: skip
    sensor = patch.sensor
    etree.SubElement(
        node, "sensor", rest=f"{sensor.rest:g}", pascal_per_count=f"{sensor.pascal_per_count:g}",
        min=f"{sensor.lowest:g}", max=f"{sensor.highest:g}",
    )  # fmt: skip
    cone = patch.surface
    if not isinstance(cone, TruncatedCone):
        raise TciError(f"the skin {patch.name} is no truncated cone and is not written; add it by hand")
    etree.SubElement(
        node, "truncated_cone", origin=_metres(cone.origin), rpy=" ".join(_degrees(a) for a in cone.rpy),
        length=f"{cone.length:.4g}", r1=f"{cone.r1:.4g}", r2=f"{cone.r2:.4g}",
        rings=str(cone.rings), per_ring=str(cone.per_ring),
    )  # fmt: skip


def _degrees(angle: float) -> str:
    return f"{round(float(np.rad2deg(angle)), PLACES):.10g}"


def _metres(values: Iterable[float]) -> str:
    return " ".join(f"{value:.5f}" for value in values)
