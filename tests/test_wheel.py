"""The wheel and the sdist install elsewhere and run the demo: NAO alone, without the icub extra."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OURS = ("tci", "tactile", "icub")
"""In the names of what is not lent to the new environment."""


def run(*command: object) -> subprocess.CompletedProcess[str]:
    """A command that ends well, and finds only what is installed."""
    words = [str(word) for word in command]
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=clean)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.xdist_group("wheel")
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_it_installs_elsewhere_and_runs(kind: str, tmp_path: Path) -> None:
    dist = tmp_path / "dist"
    run(sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", dist, ROOT)
    (built,) = dist.iterdir()
    venv.create(tmp_path / "venv", with_pip=False)
    python = tmp_path / "venv" / "bin" / "python"
    # Dependencies are lent from here, so that the test needs no network; TCI and icub-models are not.
    site = Path(sysconfig.get_path("purelib"))
    there = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip())
    for entry in site.iterdir():
        if not any(name in entry.name for name in OURS):
            (there / entry.name).symlink_to(entry)
    run(python, "-m", "pip", "install", "--no-deps", "--no-index", "--no-build-isolation", built)
    place = run(python, "-c", "import tci; print(tci.__file__)").stdout.strip()
    assert Path(place).is_relative_to(tmp_path)
    out = tmp_path / "out"
    demo = run(tmp_path / "venv" / "bin" / "tci", "demo", "--headless", "--out", out)
    assert "pip install 'tactile-capabilities[icub]'" in demo.stderr
    trials = json.loads((out / "report.json").read_text())["trials"]
    assert {trial["robot"] for trial in trials} == {"nao"}
    assert all(trial["responded"] for trial in trials)
    assert (out / "demo.png").stat().st_size > 50_000
