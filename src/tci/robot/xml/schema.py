"""Makes two files from the grammar: `robot.xsd` for editors, and the table of elements in
docs/robot-description.md.

`python -m tci.robot.xml.schema PATH` writes the schema if PATH ends in .xsd, and the table if PATH ends in
.md.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from lxml import etree
from lxml.builder import ElementMaker

from tci.robot.description import Description
from tci.robot.xml.element import Element
from tci.robot.xml.grammar import GENERIC_ROBOT, ROOT, UNIT
from tci.robot.xml.values import (
    NUMBER,
    Angle,
    Choice,
    Choices,
    Flag,
    Integer,
    Integers,
    Name,
    Number,
    RelativePath,
    Three,
    Value,
)

_NAMESPACE = "http://www.w3.org/2001/XMLSchema"
_XS = ElementMaker(namespace=_NAMESPACE, nsmap={"xs": _NAMESPACE})
_DECIMAL = "pattern", NUMBER.replace("?:", "")
_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!-- Schema of TCI's robot descriptions, for editors: completion, and marks under what is misspelt. Made by
     tci.robot.xml.schema. `tci check FILE` checks much more, and is what counts. -->
"""


def schema_text() -> str:
    """Returns the grammar of descriptions as an XML schema (XSD 1.0)."""
    types: dict[Value, str] = {}
    root = _element(ROOT, GENERIC_ROBOT, types)
    simple = [_XS.simpleType(_restriction(value), name=name) for value, name in types.items()]
    schema = _XS.schema(*simple, root, elementFormDefault="qualified")
    etree.indent(schema)
    for one in schema.iter(f"{{{_NAMESPACE}}}simpleType", f"{{{_NAMESPACE}}}annotation"):
        for inner in one.iterdescendants():  # each element is written on one line
            one.text = inner.tail = None
            inner.text = (inner.text or "").strip() or None
    return f"{_HEAD}{etree.tostring(schema, encoding='unicode')}\n"


def table_text() -> str:
    """Returns the table of all elements in Markdown."""
    rows = [f"| {tag} | {_holds(element)} | {element.about} |" for tag, element in _walk(ROOT, GENERIC_ROBOT)]
    return "\n".join(["| element | attributes and children | meaning |", "|---|---|---|", *rows, ""])


def _walk(tag: str, element: Element, above: str = "") -> Iterator[tuple[str, Element]]:
    yield f"`{tag}` of `{above}`" if tag in ("servo", "point") else f"`{tag}`", element
    for name, child in element.children.items():
        yield from _walk(name, child, tag)


def _holds(element: Element) -> str:
    def described(name: str, value: Value) -> str:
        default = element.default(name)
        notes = [value.says, "" if default in (None, "") else f"default {value.write(default)}"]
        note = "; ".join(filter(None, notes))
        return f"`{name}` ({note})" if note else f"`{name}`"

    parts = [
        element.text.says or "number" if element.text else "",
        ", ".join(described(name, value) for name, value in element.needs.items()),
        "optional " + ", ".join(described(name, value) for name, value in element.may.items())
        if element.may
        else "",
        "children " + ", ".join(f"`{tag}`" for tag in element.children) if element.children else "",
    ]
    return "; ".join(filter(None, parts))


def _element(tag: str, element: Element, types: dict[Value, str]) -> etree._Element:
    kind = _XS.complexType()
    content = kind
    if element.text is not None:
        content = _XS.extension(base=_type(element.text, types))
        kind.append(_XS.simpleContent(content))
    needed, often = {**element.must, **element.some}, {**element.some, **element.many}
    children = {name: _element(name, child, types) for name, child in element.children.items()}
    if often:
        least = "1" if needed else "0"
        content.append(_XS.choice(*children.values(), minOccurs=least, maxOccurs="unbounded"))
    elif children:
        for name in element.once:
            children[name].set("minOccurs", "0")
        content.append(_XS.all(*children.values()))
    texts = _texts(element.describes)
    for name, value in element.values.items():
        text = texts.get(element.field(name) or "", "")
        if value.angular:  # an angle in the file has the unit of the file
            text = re.sub(r" \[rad[^]]*\]", "", text)
        attribute = _XS.attribute(*_note(text), name=name, type=_type(value, types))
        if name in element.needs:
            attribute.set("use", "required")
        content.append(attribute)
    if element.angular:
        content.append(_XS.attribute(name="type", type=_type(UNIT, types)))
    return _XS.element(*_note(element.about), kind, name=tag)


def _note(text: str) -> list[etree._Element]:
    """Returns the XSD annotation that editors show for an element: `text` without its Markdown. The list is
    empty if `text` is empty."""
    plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", " ".join(text.split())).replace("`", "")
    return [_XS.annotation(_XS.documentation(plain))] if plain else []


def _type(value: Value, types: dict[Value, str]) -> str:
    """Returns the name of the XSD type for values of the kind `value`. `types` are the names of all types so
    far; a new type is added to them."""
    kind = type(value).__name__.lower()
    return types.setdefault(value, f"{kind}{len(types)}")


def _restriction(value: Value) -> etree._Element:
    match value:
        case Flag():
            return _restriction(Flag.words)
        case Choice(valid):
            return _restricted("token", *(("enumeration", word) for word in valid))
        case Choices(valid):
            words = _XS.list(_XS.simpleType(_restriction(Choice(valid))))
            return _XS.restriction(_XS.simpleType(words), _XS.minLength(value="1"))
        case Name(longest):
            return _restricted("string", ("minLength", 1), ("maxLength", longest))
        case RelativePath():
            return _restricted("string", ("pattern", r"[^/\\:].*"))
        case Integer(least, most, None):
            bounds = ("minInclusive", least), ("maxInclusive", most)
            return _restricted("integer", ("pattern", "[0-9]{1,9}"), *bounds)
        case Integer(least, most, str(word)):
            both = Integer(least, most), Choice((word,))
            return _XS.union(*(_XS.simpleType(_restriction(one)) for one in both))
        case Integers(of):
            numbers = _XS.list(_XS.simpleType(_restriction(of)))
            return _XS.restriction(_XS.simpleType(numbers), _XS.minLength(value="1"))
        case Three(of):
            numbers = _XS.list(_XS.simpleType(_restriction(of)))
            return _XS.restriction(_XS.simpleType(numbers), _XS.length(value="3"))
        case Number(least, most, positive):
            low = ("minExclusive", 0) if positive else ("minInclusive", f"{least:g}")
            return _restricted("double", _DECIMAL, low, ("maxInclusive", f"{most:g}"))
        case Angle(True):
            return _restricted("double", _DECIMAL, ("minExclusive", 0))
    return _restricted("double", _DECIMAL)


def _restricted(base: str, *facets: tuple[str, object]) -> etree._Element:
    return _XS.restriction(*(_XS(facet, value=str(value)) for facet, value in facets), base=f"xs:{base}")


def _texts(described: type[Description] | None) -> dict[str, str]:
    """Returns the docstrings of the fields of the class `described`, by the name of the field."""
    if described is None:
        return {}
    [body] = ast.parse(textwrap.dedent(inspect.getsource(described))).body
    assert isinstance(body, ast.ClassDef)
    texts = {}
    for one, after in pairwise(body.body):
        match one, after:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                texts[name] = text
    return texts


if __name__ == "__main__":
    for place in map(Path, sys.argv[1:]):
        place.write_text(schema_text() if place.suffix == ".xsd" else table_text(), encoding="utf-8")
