"""The wheel runs the demo with NAO in a new environment without the extra `icub`, and the sdist builds an
equal wheel."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

import pytest

from helpers import HELPERS, ROOT
from helpers.wheels import bare, build, install, lend_machine_code, run

OURS = ("tci", "tactile", "icub")
"""Words in the names of packages that are not linked into the new environment."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", ROOT, tmp_path_factory.mktemp("dist"))


@pytest.mark.xdist_group("wheel")
def test_the_sdist_makes_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    run("tar", "-xf", build("sdist", ROOT, tmp_path / "sdist"), "-C", tmp_path / "source")
    (source,) = (tmp_path / "source").iterdir()
    again = build("wheel", source, tmp_path / "again")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(again) as other:
        assert {name: one.read(name) for name in one.namelist()} == {
            name: other.read(name) for name in other.namelist()
        }


@pytest.mark.xdist_group("wheel")
def test_its_description_has_no_link_that_leads_nowhere_on_pypi(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as file:
        (about,) = (name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        text = file.read(about).decode().split("\n\n", 1)[1]
    assert "Write a touch behaviour once" in text
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert links
    assert all(link.startswith("https://") for link in links)


@pytest.mark.xdist_group("wheel")
def test_it_installs_elsewhere_and_runs(wheel: Path, tmp_path: Path) -> None:
    # Dependencies are linked from this environment, so that the test needs no network. TCI and icub-models
    # are not linked.
    python, _ = bare(tmp_path / "venv", lambda name: not any(ours in name for ours in OURS))
    install(python, wheel)
    place = Path(run(python, "-c", "import tci; print(tci.__file__)").stdout.strip())
    assert place.is_relative_to(tmp_path)
    lend_machine_code(place.parent)
    out = tmp_path / "out"
    demo = run(tmp_path / "venv" / "bin" / "tci", "demo", "--headless", "--out", out)
    assert "pip install 'tactile-capabilities[icub]'" in demo.stderr
    trials = json.loads((out / "report.json").read_text())["trials"]
    assert {trial["robot"] for trial in trials} == {"nao"}
    assert all(trial["responded"] for trial in trials)
    assert (out / "demo.png").stat().st_size > 50_000


@pytest.mark.xdist_group("wheel")
def test_yarpwire_is_a_package_of_its_own_with_the_same_files(wheel: Path, tmp_path: Path) -> None:
    alone = build("wheel", ROOT / "packages" / "yarpwire", tmp_path / "dist")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(alone) as other:
        held = {name.split("/")[0] for name in one.namelist() if ".dist-info/" not in name}
        both = [{name: file.read(name) for name in file.namelist() if name.startswith("yarpwire/")}
                for file in (one, other)]  # fmt: skip
        assert held == {"tci", "yarpwire"}
        assert both[1].pop("yarpwire/LICENSE") == (ROOT / "LICENSE").read_bytes()
        assert both[0] == both[1]
    python, there = bare(tmp_path / "venv", lambda name: name.startswith(("numpy", "pip")))
    install(python, alone)
    assert not (there / "tci").exists()
    assert run(python, HELPERS / "yarpwire_five_lines.py").stdout == "[240.  17.]\n"
