"""`Element`: the valid content of one XML element. The dialect (`grammar`) consists of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tci.robot.description import Description
from tci.robot.xml.values import Value


@dataclass(frozen=True)
class Element:
    """Valid content of one element."""

    about: str = ""
    """Meaning, in Markdown. It describes an attribute only if the described type does not."""
    needs: Mapping[str, Value] = field(default_factory=dict)
    """Required attributes."""
    may: Mapping[str, Value] = field(default_factory=dict)
    """Optional attributes."""
    text: Value | None = None
    """Value of its text; None if it has no text."""
    must: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur exactly once."""
    once: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur at most once."""
    some: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur at least once."""
    many: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur any number of times."""
    describes: type[Description] | None = None
    """Type of `tci.robot.description` that the element becomes."""
    fields: Mapping[str, str | None] = field(default_factory=dict)
    """Fields of that type by the name of the attribute or child, if the names differ; None: there is no
    field."""

    @property
    def children(self) -> dict[str, Element]:
        """Returns all possible children."""
        return {**self.must, **self.once, **self.some, **self.many}

    @property
    def values(self) -> dict[str, Value]:
        """Returns all attributes except `type`."""
        return {**self.needs, **self.may}

    @property
    def angular(self) -> bool:
        """Returns True if it contains an angle, so that `type` may set a unit that differs from that of the
        root."""
        return any(value.angular for value in [*self.values.values(), self.text] if value is not None)

    def field(self, name: str) -> str | None:
        """Returns the field for an attribute, or for a child with a value; None if there is no field."""
        found = self.fields.get(name, name)
        return found if self.describes is not None and found in self.describes.model_fields else None

    def default(self, name: str) -> Any:
        """Returns the default of an attribute, or of a child with a value."""
        found = self.field(name)
        if self.describes is None or found is None or self.describes.model_fields[found].is_required():
            return None
        return self.describes.model_fields[found].default
