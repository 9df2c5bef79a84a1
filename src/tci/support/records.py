"""Faster creation of frozen data classes.

The `__init__` of a frozen data class calls `object.__setattr__` once per field, because the class forbids
assignments. In a control period of a robot with skin, these calls took more time than most compiled loops.
"""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any, TypeVar

T = TypeVar("T")


def quick(kind: type[T]) -> type[T]:
    """Changes a frozen data class with slots: objects are created two to four times as fast, and the class is
    final (it can't have subclasses).

    A new object first belongs to a helper class, which has the same slots and permits assignments. After the
    last assignment, the class of the object is changed to `kind`. This is not possible for a subclass, so a
    subclass of `kind` raises TypeError. Raises TypeError if `kind` has a field that is computed or can be set
    only by keyword.
    """
    cls: Any = kind
    names, parameters, defaults = [], ["cls"], {}
    for one in fields(cls):
        if not one.init or one.kw_only or one.default_factory is not MISSING:
            raise TypeError(f"{cls.__name__}.{one.name}; valid: a field with at most a default value")
        names.append(one.name)
        parameters.append(one.name)
        if one.default is not MISSING:
            defaults[f"_{one.name}"] = one.default
            parameters[-1] += f"=_{one.name}"
    own = {name: vars(cls)[name] for name in ("__slots__", "__orig_bases__") if name in vars(cls)}
    open_kind = type(cls.__name__, (cls.__base__,), own)
    lines = [
        f"def __new__({', '.join(parameters)}):",
        "self = _new(_open_kind)",
        *(f"self.{name} = {name}" for name in names),
        "self.__class__ = cls",
        *(["self.__post_init__()"] if hasattr(cls, "__post_init__") else []),
        "return self",
    ]
    room: dict[str, Any] = {"_new": object.__new__, "_open_kind": open_kind, **defaults}
    exec("\n    ".join(lines), room)
    cls.__new__ = room["__new__"]
    del cls.__init__

    def refuse(subclass: type, /, **options: Any) -> None:
        raise TypeError(f"{subclass.__name__}: {kind.__name__} is final; valid: a class with a field for it")

    cls.__init_subclass__ = classmethod(refuse)
    if cls.__reduce__ is object.__reduce__:
        cls.__reduce__ = lambda self: (type(self), tuple([getattr(self, name) for name in names]))
    return kind
