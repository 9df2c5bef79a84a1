"""The file of receptive fields: the content of TCI's file, and the report of all faults of a wrong file at
once."""

from __future__ import annotations

from math import pi, radians
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from helpers.touches import one_field
from tci.capabilities.fields import default_fields, load_fields
from tci.errors import DescriptionError
from tci.skin.contacts import Measure

GOOD = """
[force.total]
threshold_n = 0.1
saturation_n = 0.5
[[field]]
name = "one"
segment = "forearm"
u = 0.5
theta_deg = 90
radius = 0.25
motion_deg = [10, 0, -20.5, 0, 0]
"""


def faults_of(tmp_path: Path, text: str | bytes) -> list[str]:
    path = tmp_path / "fields.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(DescriptionError) as caught:
        load_fields(path)
    assert str(path) in str(caught.value)
    return [fault.message for fault in caught.value.faults]


@pytest.mark.parametrize("measure", ["total", "weighted", "peak"])
def test_five_sites_four_on_the_forearm(measure: Measure) -> None:
    fields = default_fields(measure=measure)
    assert [field.segment for field in fields] == ["forearm"] * 4 + ["upper_arm"]
    assert len({field.name for field in fields}) == 5
    assert all(field.measure == measure for field in fields)
    assert all(-pi < field.theta <= pi for field in fields)


def test_a_file_is_read_in_its_units(tmp_path: Path) -> None:
    path = tmp_path / "fields.toml"
    path.write_text(GOOD)
    (field,) = load_fields(path)
    assert (field.name, field.segment, field.u, field.radius) == ("one", "forearm", 0.5, 0.25)
    assert field.theta == radians(90)
    assert field.motion == (radians(10), 0.0, radians(-20.5), 0.0, 0.0)
    assert (field.measure, field.threshold, field.saturation) == ("total", 0.1, 0.5)


@pytest.mark.parametrize(
    ("wrong", "place", "valid"),
    [
        ("radius = 0", "field 1 (one), radius", "greater than 0; got 0"),
        ("radius = nan", "field 1 (one), radius", "finite number; got nan"),
        ("radius = true", "field 1 (one), radius", "valid number; got True"),
        ("radius = '0.3'", "field 1 (one), radius", "valid number; got '0.3'"),
        ("u = 1.5", "field 1 (one), u", "less than or equal to 1; got 1.5"),
        ("theta_deg = inf", "field 1 (one), theta_deg", "finite number; got inf"),
        ("segment = 'thigh'", "field 1 (one), segment", "'upper_arm' or 'forearm'; got 'thigh'"),
        ("motion_deg = [1, 2, 3]", "field 1 (one), motion_deg", "needs 5 angles"),
        ("motion_deg = [1, 2, 3, 4, 5, 6]", "field 1 (one), motion_deg", "needs 5 angles"),
        ("motion_deg = [1, 2, nan, 4, 5]", "field 1 (one), motion_deg.2", "finite number; got nan"),
        ("name = 'One two'", "field 1 (One two), name", "match pattern"),
        ("threshold_n = -0.1", "force.total.threshold_n", "greater than or equal to 0; got -0.1"),
        ("saturation_n = 0.1", "force.total", "above threshold_n, which is 0.1"),
    ],
)
def test_a_wrong_value_is_named_with_its_place(tmp_path: Path, wrong: str, place: str, valid: str) -> None:
    key = wrong.split(" = ")[0]
    text = "\n".join(wrong if line.startswith(f"{key} =") else line for line in GOOD.splitlines())
    (fault,) = faults_of(tmp_path, text)
    assert fault.startswith(f"{place}: ")
    assert valid in fault


@pytest.mark.parametrize("key", ["name", "segment", "u", "theta_deg", "radius", "motion_deg"])
def test_a_missing_key_is_named(tmp_path: Path, key: str) -> None:
    text = "\n".join(line for line in GOOD.splitlines() if not line.startswith(f"{key} ="))
    (fault,) = faults_of(tmp_path, text)
    assert fault == f"field 1 ({'no name' if key == 'name' else 'one'}), {key}: Field required"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (GOOD + "colour = 'red'", "field 1 (one), colour: unknown key; valid: name, segment, u, radius, "),
        ("version = 1\n" + GOOD, "version: unknown key; valid: force, field"),
        (GOOD.replace("[[", "unit = 'N'\n[["), "force.total.unit: unknown key; valid: threshold_n, "),
        (GOOD.replace("force.total", "force.mean"), "force.mean: Input should be 'total', 'weighted' or "),
    ],
    ids=["field", "file", "range", "measure"],
)
def test_an_unknown_key_is_refused_with_those_that_are_known(tmp_path: Path, text: str, fault: str) -> None:
    assert faults_of(tmp_path, text)[0].startswith(fault)


def test_all_faults_come_together(tmp_path: Path) -> None:
    text = GOOD + GOOD[GOOD.index("[[field]]") :].replace("0.25", "-1") + "colour = 'red'\n"
    text = text.replace("saturation_n = 0.5", "saturation_n = 0.0").replace("90", "nan", 1)
    faults = faults_of(tmp_path, text)
    expected = [
        "force.total",
        "theta_deg",
        "field 2 (one), radius",
        "field 2 (one), colour",
        "named 'one'",
    ]
    assert len(faults) == len(expected)
    for words in expected:
        assert any(words in fault for fault in faults), words


def test_a_measure_without_thresholds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "fields.toml"
    path.write_text(GOOD)
    with pytest.raises(DescriptionError, match=r"'peak'; the file has: total"):
        load_fields(path, measure="peak")


def test_what_is_not_a_file_of_fields(tmp_path: Path) -> None:
    assert "line 2" in faults_of(tmp_path, "field = 3\nfield = 4\n")[0]
    assert "UTF-8" in faults_of(tmp_path, b"name = '\xff'")[0]
    assert faults_of(tmp_path, "") == ["force: Field required", "field: Field required"]
    assert any("field" in fault for fault in faults_of(tmp_path, "field = 3"))
    assert any("field 1 (no table)" in fault for fault in faults_of(tmp_path, "field = [3]"))
    with pytest.raises(DescriptionError, match="can't be read"):
        load_fields(tmp_path / "nowhere.toml")


@pytest.mark.parametrize(
    "changes",
    [{"radius": 0.0}, {"saturation": 1.0}, {"motion": (0.1,)}, {"theta": float("nan")}, {"u": -0.1}],
)
def test_a_field_made_in_a_program_is_checked_too(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        one_field(**changes)
