"""Writer of a robot's description as XML text, with angles in degrees. This is the inverse of
`read_robot`."""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import Any

from lxml import etree

from tci.errors import TciError
from tci.robot.description import (
    USUAL_ACTUATORS,
    GenericPart,
    GenericServo,
    Patch,
    Robot,
    Servo,
    Table,
    TriangularModules,
)
from tci.robot.xml.element import Element
from tci.robot.xml.grammar import GENERIC_ROBOT, LIMITS, ROOT


def write_robot(
    robot: Robot, *, file: str, extra: str | None = None, meshes: str | None = None, comment: str = ""
) -> str:
    """Returns the text of a description.

    `file` is the path of the model relative to the description. If `robot.model` names a package that
    contains the model, `file` is the last part of the model's path in this package, and `extra` is the extra
    of TCI that installs the package. `meshes` is a folder beside the description, or "none" for a model that
    is to be read without its meshes.

    Tables of taxels are named as files beside the description. Raises TciError if the robot has couplings,
    attached models, transforms of the kind `coupled`, or response curves: this function can't write them.
    """
    if robot.couplings:
        raise TciError("couplings are not written; add them by hand")
    if robot.model is not None and robot.model.attachments:
        raise TciError("models that are attached to the model are not written; add them by hand")
    root = _Written(etree.Element(ROOT), GENERIC_ROBOT)
    root.fill(robot, angle_unit="deg", version="1")
    if comment:
        plain = comment.replace("--", "-")  # XML does not allow "--" in a comment
        lines = [line for part in plain.splitlines() for line in wrap(part, 105)]
        root.node.append(etree.Comment(" " + "\n     ".join(lines) + " "))
    if robot.model is not None:
        root.add("model", robot.model, file=file, extra=extra, meshes=meshes)
    for name in dict.fromkeys(servo.robot_part for servo in robot.servos):
        own = robot.servos_of(name)
        part = root.add("robot_part", name=name, modes=[mode.value for mode in own[0].modes])
        for servo in own:
            _servo(part, servo, None if servo.modes == own[0].modes else [mode.value for mode in servo.modes])
    for generic in robot.parts:
        _part(root, robot, generic)
    if robot.patches:
        skin = root.add("skin")
        for patch in robot.patches:
            _patch(skin, patch)
    for binding in robot.bindings:
        written = root.add("binding", binding)
        for address in binding.addresses:
            written.add("address", address)
        for via in binding.sources:
            written.add("source", via=via)
    etree.indent(root.node)
    text: str = etree.tostring(root.node, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


class _Written:
    """XML element that is being written, with the rules of the grammar for this element."""

    def __init__(self, node: etree._Element, grammar: Element) -> None:
        self.node = node
        self.grammar = grammar

    def add(self, tag: str, described: object = None, **given: Any) -> _Written:
        """Appends a child element named `tag` and returns it. The child contains the values in `given`, by
        name, and all fields of the object `described` that differ from their defaults."""
        child = _Written(etree.SubElement(self.node, tag), self.grammar.children[tag])
        child.fill(described, **given)
        return child

    def fill(self, described: object = None, **given: Any) -> None:
        """Writes into the element the values in `given`, by name, and all fields of the object `described`
        that differ from their defaults."""
        grammar = self.grammar
        held = {tag: child.text for tag, child in grammar.children.items() if child.text is not None}
        for name, value in (grammar.values | held).items():
            found = given.get(name, getattr(described, grammar.field(name) or "", None))
            usual = name not in grammar.needs and name not in given and found == grammar.default(name)
            if found is None or usual:
                continue
            if name in held:
                etree.SubElement(self.node, name).text = value.write(found)
            else:
                self.node.set(name, value.write(found))


def _servo(part: _Written, servo: Servo, modes: list[str] | None) -> None:
    written, limits = part.add("servo", servo, modes=modes), servo.limits
    for tag, grammar in LIMITS.items():
        fields = {field for field in grammar.fields.values() if field}
        if all(getattr(limits, field) is not None for field in fields):
            written.add(tag, limits, origin=None if fields.isdisjoint(limits.assumed) else "assumed")
    for mimic in servo.mimics:
        written.add("slide" if mimic.slides else "mimic", mimic)


def _part(root: _Written, robot: Robot, part: GenericPart) -> None:
    homes = [robot.servos[s.servo].robot_part for s in part.servos if s.servo is not None]
    home = homes[0] if homes else robot.servos[0].robot_part
    written = root.add("generic_robot_part", part, robot_part=home, generic_servo_number=len(part.servos))
    if any(part.mount):
        written.add("mount", **dict(zip(("roll", "pitch", "yaw"), part.mount, strict=True)))
    if part.eyes is not None:
        written.add("eyes", part.eyes)
    for servo in part.servos:
        _generic_servo(written, robot, home, servo)
    mapped = [servo for servo in part.servos if servo.servo is not None]
    if mapped:
        initial = written.add("initial_positions")
        for servo in mapped:
            initial.add("servo", destination_servo_id=servo.id, pos=servo.initial)
    for segment in part.segments:
        written.add("segment", segment)
    for actuator in part.cartesian:
        if actuator not in USUAL_ACTUATORS:
            written.add("cartesian_actuator", actuator)


def _generic_servo(part: _Written, robot: Robot, home: str, servo: GenericServo) -> None:
    if servo.transform not in ("linear", "synergy", "retarget"):
        raise TciError(f"the transform {servo.transform} is not written; add it by hand")
    if servo.servo is None:
        written = part.add("generic_servo", servo, destination_servo_id="none", fixed_position=servo.fixed)
        return
    own = robot.servos[servo.servo]
    written = part.add("generic_servo", servo, destination_servo_id=own.id)
    if own.robot_part != home:
        written.node[0].set("robot_part", own.robot_part)
    for term in servo.terms:
        moved = robot.servos[term.servo]
        elsewhere = None if moved.robot_part == home else moved.robot_part
        written.add("coupled_term", destination_servo_id=moved.id, factor=term.factor, robot_part=elsewhere)


def _patch(skin: _Written, patch: Patch) -> None:
    if patch.sensor.response:
        raise TciError(f"the response curve of the skin {patch.name} is not written; add it by hand")
    written = skin.add("patch", patch)
    if patch.through_joints:
        written.add("felt_through_joints")
    else:
        written.add("sensor", patch.sensor)
    surface = patch.surface
    if isinstance(surface, TriangularModules):
        modules = written.add(surface.kind)
        turns = surface.turns or (0.0,) * len(surface.frames)
        for frame, port, turn in zip(surface.frames, surface.ports, turns, strict=True):
            modules.add("module", frame=frame, port=port, turn=turn or None)
    elif isinstance(surface, Table):
        written.add(surface.kind, surface, file=Path(surface.file).name)
    else:
        written.add(surface.kind, surface)
