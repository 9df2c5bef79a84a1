"""Each wire says what it said when `tests/golden/wires` was recorded: no refactoring changes a message."""

from __future__ import annotations

import json
from typing import Any

import pytest

from helpers.golden_wires import FOLDER, WIRES, said


def differences(now: Any, before: Any, place: str) -> list[str]:
    """Places at which messages differ. Numbers outside of bytes may differ by 1e-9, since the last digits of
    a computation differ between processors."""
    if isinstance(now, float) and isinstance(before, float | int):
        return [] if now == pytest.approx(before, abs=1e-9, rel=1e-9) else [f"{place}: {now}, was {before}"]
    if type(now) is not type(before):
        return [f"{place}: {now!r}, was {before!r}"]
    if isinstance(now, dict):
        if now.keys() != before.keys():
            return [f"{place}: {sorted(now)}, was {sorted(before)}"]
        return [word for name in now for word in differences(now[name], before[name], f"{place}.{name}")]
    if isinstance(now, list):
        if len(now) != len(before):
            return [f"{place}: {len(now)} items, was {len(before)}"]
        pairs = enumerate(zip(now, before, strict=True))
        return [word for number, pair in pairs for word in differences(*pair, f"{place}[{number}]")]
    return [] if now == before else [f"{place}: {now!r:.80}, was {before!r:.80}"]


@pytest.mark.parametrize("name", WIRES)
def test_what_a_wire_says_has_not_changed(name: str) -> None:
    recorded = json.loads((FOLDER / f"{name}.json").read_text())
    assert recorded["driver"]
    assert recorded["server"]
    assert not differences(json.loads(json.dumps(said(name))), recorded, name)


def test_every_recorded_wire_is_compared() -> None:
    assert {path.stem for path in FOLDER.glob("*.json")} == set(WIRES)


@pytest.mark.parametrize(
    ("now", "places"),
    [
        ({"a": [1.0, "00ff"]}, []),
        ({"a": [1.0 + 1e-12, "00ff"]}, []),
        ({"a": [1.0 + 1e-6, "00fe"]}, ["w.a[0]", "w.a[1]"]),
        ({"a": [1.0]}, ["w.a"]),
        ({"b": []}, ["w"]),
        ({"a": [True, "00ff"]}, ["w.a[0]"]),
    ],
)
def test_a_difference_is_found_with_its_place(now: Any, places: list[str]) -> None:
    found = differences(now, {"a": [1.0, "00ff"]}, "w")
    assert [one.split(": ")[0] for one in found] == places
