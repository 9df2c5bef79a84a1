"""`Element`: the valid content of one XML element. The grammar of descriptions (`grammar`) consists of these
objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tci.robot.description import Description
from tci.robot.xml.values import Value


@dataclass(frozen=True)
class Element:
    """Valid content of one XML element."""

    about: str = ""
    """Meaning of the element, in Markdown. Also explains those attributes that have no docstring in the class
    `describes`."""
    needs: Mapping[str, Value] = field(default_factory=dict)
    """Required attributes by name, each with its kind of value."""
    may: Mapping[str, Value] = field(default_factory=dict)
    """Optional attributes by name, each with its kind of value."""
    text: Value | None = None
    """Kind of value that the element's text must have; None if the element has no text."""
    must: Mapping[str, Element] = field(default_factory=dict)
    """Child elements by tag that occur exactly once."""
    once: Mapping[str, Element] = field(default_factory=dict)
    """Child elements by tag that occur at most once."""
    some: Mapping[str, Element] = field(default_factory=dict)
    """Child elements by tag, each of which must occur at least once."""
    many: Mapping[str, Element] = field(default_factory=dict)
    """Child elements by tag that occur any number of times."""
    describes: type[Description] | None = None
    """Type in `tci.robot.description` to which the element is converted."""
    fields: Mapping[str, str | None] = field(default_factory=dict)
    """Maps the name of an attribute or child to the name of its field in the class `describes`, if the two
    names differ. None means that the class has no field for this attribute or child."""

    @property
    def children(self) -> dict[str, Element]:
        """All children that the element may have."""
        return {**self.must, **self.once, **self.some, **self.many}

    @property
    def values(self) -> dict[str, Value]:
        """All attributes of the element except `type`."""
        return {**self.needs, **self.may}

    @property
    def angular(self) -> bool:
        """True if the element contains an angle. Its attribute `type` may then give the unit of this angle,
        if the unit differs from that of the root element."""
        return any(value.angular for value in [*self.values.values(), self.text] if value is not None)

    def field(self, name: str) -> str | None:
        """Returns the name of the field to which the value of an attribute or child is converted; None if
        there is no such field."""
        found = self.fields.get(name, name)
        return found if self.describes is not None and found in self.describes.model_fields else None

    def default(self, name: str) -> Any:
        """Returns the default of an attribute or child element; None if there is no default."""
        found = self.field(name)
        if self.describes is None or found is None or self.describes.model_fields[found].is_required():
            return None
        return self.describes.model_fields[found].default
