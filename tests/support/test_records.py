"""The decorator `quick` makes the creation of data-class objects faster. The classes stay frozen, and become
final."""

import copy
import pickle
from dataclasses import FrozenInstanceError, dataclass, field, replace
from inspect import signature
from typing import Generic, TypeVar

import numpy as np
import pytest

from tci.messages import GenericCommand, SkinFrame
from tci.support.records import quick

T = TypeVar("T")


@quick
@dataclass(frozen=True, slots=True)
class Pair:
    first: int
    second: str = "b"

    def __post_init__(self) -> None:
        if self.first < 0:
            raise ValueError("negative")


def test_fields_defaults_and_checks_are_those_of_the_data_class() -> None:
    assert Pair(1) == Pair(first=1, second="b")
    assert hash(Pair(1)) == hash(Pair(1))
    assert repr(Pair(1)) == "Pair(first=1, second='b')"
    assert replace(Pair(1), second="c") == Pair(1, "c")
    assert list(signature(Pair).parameters) == ["first", "second"]
    for wrong in ((), (1, "b", 3)):
        with pytest.raises(TypeError):
            Pair(*wrong)
    with pytest.raises(ValueError, match="negative"):
        Pair(-1)


def test_an_object_stays_frozen() -> None:
    pair, frame = Pair(1), SkinFrame("patch", 0.0, 1, np.zeros(2))
    with pytest.raises(FrozenInstanceError):
        pair.first = 2
    with pytest.raises(FrozenInstanceError):
        frame.stamp = 2.0
    assert type(frame) is SkinFrame
    assert not hasattr(pair, "__dict__")


def test_copies_and_pickles_are_equal() -> None:
    for other in (copy.copy(Pair(1)), copy.deepcopy(Pair(1)), pickle.loads(pickle.dumps(Pair(1)))):
        assert other == Pair(1)
        assert type(other) is Pair
    frame = pickle.loads(pickle.dumps(SkinFrame("patch", 0.5, 1, np.arange(3))))
    assert (frame.patch, frame.stamp, frame.sequence, frame.values.tolist()) == ("patch", 0.5, 1, [0, 1, 2])


def test_a_generic_class_can_be_quick() -> None:
    @quick
    @dataclass(frozen=True, slots=True)
    class Box(Generic[T]):
        content: T

    box: Box[int] = Box(3)
    assert (type(box), box.content, replace(box, content=4)) == (Box, 3, Box(4))


def test_a_computed_field_is_refused() -> None:
    @dataclass(frozen=True, slots=True)
    class Computed:
        values: list[int] = field(default_factory=list)

    with pytest.raises(TypeError, match="values; valid"):
        quick(Computed)


def test_a_subclass_is_refused_where_it_is_written() -> None:
    """In an earlier version the first object of a subclass ended in an error about its layout."""
    with pytest.raises(TypeError, match="Own: GenericCommand is final; valid: a class with a field for it"):
        type("Own", (GenericCommand,), {})
