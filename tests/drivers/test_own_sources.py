"""Sources that a robot's description names, so that nobody has to give them with each command."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tci
from helpers.still_nao import StillNao
from tci.cli.main import app
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DescriptionError, UnknownNameError
from tci.robot.xml.writer import write_robot

OWN = "array:feed,patch=left_forearm"


def owned(folder: Path, middleware: str, via: str) -> Path:
    """A NAO whose owner has put a source on its arm."""
    nao = tci.load_robot("nao").source
    assert nao is not None
    shutil.copytree(Path(nao).parent, folder)
    path = folder / "owned.xml"
    source = f'<source via="{via}"/>'
    path.write_text(
        f'<generic_robot extends="robot.xml" name="owned">\n<binding middleware="{middleware}" rate="100"'
        f' stale_after="0.1">\n{source}\n</binding></generic_robot>'
    )
    return path


def test_they_come_with_their_driver_and_yield_to_those_of_the_command(tmp_path: Path) -> None:
    path = owned(tmp_path / "nao", "naoqi", OWN)
    values = np.full(240, 77, np.uint8)
    with StillNao() as body:
        with tci.connect(path, body.via) as driver:
            driver.feed("left_forearm", values)
            seen = None
            for _ in driver.ticks(duration=2.0):
                seen = next((one for one in driver.read().skin if one.patch == "left_forearm"), None)
                if seen is not None and np.array_equal(seen.values, values):
                    break
            assert seen is not None
            assert np.array_equal(seen.values, values)
            assert OWN in [one.subject for one in driver.diagnose()], "the doctor does not name it"
        with tci.connect(path, f"{body.via} + array:feed,patch=right_forearm") as driver:
            driver.feed("right_forearm", values)
            with pytest.raises(CommandError, match="no source for 'left_forearm'"):
                driver.feed("left_forearm", values)
    with tci.connect(path, "sim") as driver:
        assert isinstance(driver, SimulatedDriver)


def test_they_are_told_written_and_refused_where_they_can_not_be(tmp_path: Path) -> None:
    path = owned(tmp_path / "nao", "naoqi", OWN)
    said = CliRunner().invoke(app, ["describe", str(path)], env={"COLUMNS": "200"})
    assert f"with {OWN}" in said.stdout
    robot = tci.load_robot(path)
    again = path.with_name("again.xml")
    again.write_text(write_robot(robot, file="nao.mjcf.xml"))
    assert tci.load_robot(again).bindings == robot.bindings
    with pytest.raises(DescriptionError, match=rf"line 3: .*valid: --via 'sim \+ {OWN}'"):
        tci.load_robot(owned(tmp_path / "sim", "sim", OWN))
    typo = owned(tmp_path / "typo", "naoqi", "inspier:10.0.0.7")
    assert "source inspier:10.0.0.7: not installed" in CliRunner().invoke(app, ["check", str(typo)]).stdout
    with pytest.raises(UnknownNameError, match=r"no source named 'inspier' .*'inspire'"):
        tci.connect(typo, "naoqi://10.0.0.5")
