"""XML elements with converted values. This module checks the elements against the grammar."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from lxml import etree

from tci.errors import meant, nearest_name
from tci.robot.xml.document import Faults, shown
from tci.robot.xml.element import Element
from tci.robot.xml.grammar import UNIT
from tci.robot.xml.values import ImplausibleError, InvalidValueError, Unit, Value

_XSI = "{http://www.w3.org/2001/XMLSchema-instance}"
"""Beginning of the names of attributes with which an XML file names its schema for editors. These attributes
are ignored."""
_SPACE = " \t\r\n"
"""Characters that are white space in XML. They are removed from both ends of the text of an element."""


@dataclass
class Node:
    """One element with its values. An invalid value or child is left out and recorded as a fault."""

    tag: str
    line: int
    unit: Unit
    values: dict[str, Any] = field(default_factory=dict)
    """Values of the attributes, by the name of the attribute, in SI units and radians."""
    text: Any = None
    """Text of the element, converted to its type, for example a number in SI units; None if the element has
    no valid text."""
    fields: dict[str, Any] = field(default_factory=dict)
    """Values of attributes and children, by the name of the field that stores the value in the class
    `Element.describes`. Attributes and children without such a field are left out."""
    children: dict[str, list[Node]] = field(default_factory=dict)
    misspelt: bool = False
    """True if the element has an unknown attribute or child. In this case, an attribute or child that seems
    to be missing may be present under a misspelt name."""
    ok: bool = True
    """True if this element and all its descendants satisfy the grammar."""

    def all(self, tag: str) -> list[Node]:
        """Returns the children with the name `tag`, in the order of the file."""
        return self.children.get(tag, [])

    def first(self, tag: str) -> Node | None:
        """Returns the only child with the name `tag`; None if there is none."""
        return next(iter(self.all(tag)), None)

    def value(self, tag: str, default: Any = None) -> Any:
        """Returns the value of the text of the only child with the name `tag`, or `default` if there is
        none."""
        child = self.first(tag)
        return default if child is None or child.text is None else child.text

    def get(self, name: str, default: Any = None) -> Any:
        """Returns the value of the attribute `name`, or `default` if the element has no such attribute."""
        return self.values.get(name, default)


def read_node(element: etree._Element, grammar: Element, unit: Unit, faults: Faults) -> Node:
    """Reads `element` and its descendants according to `grammar`. The attribute `type` of an element gives
    the unit of its angles; without this attribute the unit is `unit`."""
    reader = _Reader(element, faults)
    node = Node(str(element.tag), element.sourceline or 0, reader.unit(grammar, unit))
    reader.attributes(node, grammar)
    reader.text(node, grammar)
    reader.children(node, grammar, unit)
    held = {tag: node.value(tag) for tag, child in grammar.children.items() if child.text is not None}
    node.fields = {
        found: value
        for name, value in (node.values | held).items()
        if value is not None and (found := grammar.field(name)) is not None
    }
    node.ok = not reader.found and all(child.ok for group in node.children.values() for child in group)
    return node


def listed(names: Iterable[str], *, most: int = 40) -> str:
    """Returns valid names as text for a message, separated by commas."""
    names = list(names)
    more = f", and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more or "(none)"


def nearest(name: str, valid: Iterable[str]) -> str:
    """Returns the end of a message about a name that does not exist: ` (did you mean ...?); valid: ...`."""
    valid = list(valid)
    return f"{meant(name, valid)}; valid: {listed(valid)}"


class _Reader:
    """Reads one XML element, and records its faults. `found` is True if there was a fault."""

    def __init__(self, element: etree._Element, faults: Faults) -> None:
        self.element = element
        self.faults = faults
        self.found = False

    def fault(self, message: str, *, line: int | None = None) -> None:
        self.found = True
        self.faults.add(self.element.sourceline or 0 if line is None else line, message)

    def value(self, value: Value, text: str, what: str, unit: Unit) -> Any:
        """Converts `text` to a value of the kind `value`. If `text` is invalid, records a fault, in which
        `what` names the text, and returns None."""
        self.faults.angles += value.angular
        try:
            return value.read(text, unit)
        except InvalidValueError as error:
            self.faults.implausible += isinstance(error, ImplausibleError)
            self.fault(f"{what} is {shown(text)}: {error}")
            return None

    def unit(self, grammar: Element, unit: Unit) -> Unit:
        text = self.element.get("type")
        if text is None or not grammar.angular:
            return unit
        return self.value(UNIT, text, f"type of <{self.element.tag}>", unit) or unit

    def attributes(self, node: Node, grammar: Element) -> None:
        valid: Mapping[str, Value] = grammar.values
        missing = [name for name in grammar.needs if name not in self.element.attrib]
        for key, text in self.element.attrib.items():
            name = str(key)
            if name in valid:
                value = self.value(valid[name], str(text), f"{name} of <{node.tag}>", node.unit)
                if value is not None:
                    node.values[name] = value
            elif not (name == "type" and grammar.angular) and not name.startswith(_XSI):
                names = [*valid, *(["type"] if grammar.angular else [])]
                self.fault(f"unknown attribute {shown(name)} of <{node.tag}>{nearest(name, names)}")
                node.misspelt = True
                missing = [one for one in missing if one != nearest_name(name, names)]
        for name in missing:
            self.fault(f"<{node.tag}> needs the attribute {name}")

    def text(self, node: Node, grammar: Element) -> None:
        pieces = [self.element.text, *(child.tail for child in self.element)]
        text = "".join(piece for piece in pieces if piece).strip(_SPACE)
        if grammar.text is not None:
            node.text = self.value(grammar.text, text, f"<{node.tag}>", node.unit)
        elif text:
            self.fault(f"<{node.tag}> holds the text {shown(text)}, but only elements belong there")

    def children(self, node: Node, grammar: Element, unit: Unit) -> None:
        valid = grammar.children
        lines: dict[str, int] = {}
        misspelt = set()
        for child in self.element:
            if not isinstance(child.tag, str):
                continue  # a comment or a processing instruction
            line = child.sourceline or 0
            if child.tag not in valid:
                self.fault(
                    f"unknown element <{child.tag[:60]}> in <{node.tag}>{nearest(child.tag, valid)}",
                    line=line,
                )
                node.misspelt = True
                misspelt.add(nearest_name(child.tag, valid))
                continue
            if child.tag in lines and (child.tag in grammar.must or child.tag in grammar.once):
                first = lines[child.tag]
                self.fault(f"second <{child.tag}> in <{node.tag}>; the first is on line {first}", line=line)
                continue
            lines[child.tag] = line
            node.children.setdefault(child.tag, []).append(
                read_node(child, valid[child.tag], unit, self.faults)
            )
        for tag in [*grammar.must, *grammar.some]:
            if tag not in lines and tag not in misspelt:
                self.fault(f"<{node.tag}> needs an element <{tag}>")
