"""The wheel, and new environments in which it is installed without the network: what it needs is linked from
the environment of the tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from helpers import ROOT


def run(*command: object) -> subprocess.CompletedProcess[str]:
    """Runs a command that must succeed. The command can use only installed packages."""
    words = [str(word) for word in command]
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=clean)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def build(kind: str, source: Path, folder: Path) -> Path:
    """Builds the wheel or sdist of a source folder."""
    run(sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", folder, source)
    (built,) = folder.iterdir()
    return built


def lend_machine_code(there: Path) -> None:
    """Copies the loops' machine code, because compiling takes a minute. It is valid for equal sources."""
    here = ROOT / "src" / "tci"
    for cache in here.rglob("__pycache__/*.loop"):
        copy = there / cache.relative_to(here)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(cache, copy)


def bare(folder: Path, lent: Callable[[str], bool]) -> tuple[Path, Path]:
    """Creates a new environment and links those packages of this environment for which `lent` is true.
    Returns the Python and the package folder of the new environment."""
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    there = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip())
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if lent(entry.name):
            (there / entry.name).symlink_to(entry)
    return python, there


def install(python: Path, wheel: Path) -> None:
    run(python, "-m", "pip", "install", "--no-deps", "--no-index", "--no-build-isolation", wheel)


def needed_by(*extras: str) -> set[str]:
    """Top-level entries of the package folder that TCI needs with these extras, and pip."""
    wanted = [("tactile-capabilities", ("", *extras)), ("pip", ("",))]
    seen: set[tuple[str, tuple[str, ...]]] = set()
    found: set[str] = set()
    while wanted:
        name, own = one = wanted.pop()
        if one in seen:
            continue
        seen.add(one)
        try:
            about = distribution(name)
        except PackageNotFoundError:
            continue
        if name != "tactile-capabilities":
            found |= {
                file.parts[0] for file in about.files or () if file.parts[0] not in ("..", "__pycache__")
            }
        for text in about.requires or ():
            need = Requirement(text)
            if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in own):
                wanted.append((need.name, ("", *sorted(need.extras))))
    return found
