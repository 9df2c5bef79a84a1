"""`Element`: contents of one element of a description, of which the dialect (`grammar`) is made."""

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
    """Meaning, in Markdown; of its attributes only what the described type does not say."""
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
    """Fields of that type by the name of the attribute or child, where the names differ; None: no field."""

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
        """Returns True if it holds an angle, so that `type` may give a unit other than the root's."""
        return any(value.angular for value in [*self.values.values(), self.text] if value is not None)

    def field(self, name: str) -> str | None:
        """Returns the field that an attribute, or a child that holds a value, becomes; None if it is none."""
        found = self.fields.get(name, name)
        return found if self.describes is not None and found in self.describes.model_fields else None

    def default(self, name: str) -> Any:
        """Returns the value of an attribute, or of a child that holds a value, if the file gives none."""
        found = self.field(name)
        if self.describes is None or found is None or self.describes.model_fields[found].is_required():
            return None
        return self.describes.model_fields[found].default
