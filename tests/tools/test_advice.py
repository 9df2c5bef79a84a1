"""Advice of a refusal that names numbers of the model file is followed in a copy."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest
from lxml import etree

from helpers.made_humanoid import MadeHumanoid
from helpers.programs import program
from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose

LINK = "left_wrist_pitch_link"


@pytest.fixture(scope="module")
def advice() -> ModuleType:
    return program("advice")


def test_inertias_in_g_mm2_are_read_so(advice: ModuleType, tmp_path: Path) -> None:
    file = MadeHumanoid().urdf(tmp_path)
    text = file.read_text()
    start = text.index(f"<link name='{LINK}'>")
    given = re.compile(r"\b(i\w\w)='(\S+?)'")
    link = text[start : text.index("</link>", start)]
    in_g_mm2 = given.sub(lambda found: f"{found[1]}='{float(found[2]) * 1e9:.9g}'", link)
    file.write_text(text.replace(link, in_g_mm2))
    with pytest.raises(DescriptionError) as refused:
        propose(file, name="made")
    copy, said = advice.followed(file, str(refused.value))
    assert said == "inertias of 1 links are read in g mm2"
    assert propose(copy, name="made")
    (inertia,) = etree.parse(str(copy)).xpath(f"//link[@name='{LINK}']//inertia")
    assert {name: float(value) for name, value in inertia.attrib.items()} == pytest.approx(
        {name: float(value) for name, value in given.findall(link)}
    )


def test_the_twins_torque_replaces_a_weak_one(advice: ModuleType, tmp_path: Path) -> None:
    file = MadeHumanoid().urdf(tmp_path)
    refusal = "left_elbow: its torque of 15 N m is too little; valid: 50 N m, as right_elbow has"
    (before,) = etree.parse(str(file)).xpath("//joint[@name='left_elbow']/limit/@effort")
    copy, said = advice.followed(file, refusal)
    assert said == "left_elbow has 50 N m"
    (after,) = etree.parse(str(copy)).xpath("//joint[@name='left_elbow']/limit/@effort")
    assert float(after) == pytest.approx(float(before) * 50.0 / 15.0)


def test_a_refusal_without_such_advice_changes_nothing(advice: ModuleType, tmp_path: Path) -> None:
    file = MadeHumanoid().urdf(tmp_path)
    assert advice.followed(file, "no mirrored limbs; valid: --arms LEFT,RIGHT") is None
    assert list(tmp_path.glob("tci-advised-*")) == []
