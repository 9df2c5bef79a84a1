"""Checks what would be published: builds it, installs it where nothing is, runs the README's program.

    make release-check PYTHONS="python3.11 python3.12"

Every Python version of the classifiers must be among PYTHONS, so none is promised that was not tried.
"""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from packaging.metadata import Metadata
from trove_classifiers import classifiers

ROOT = Path(__file__).parents[1]
VERSION = "import sys; print('%d.%d' % sys.version_info[:2])"


def say(*command: object, cwd: Path = ROOT) -> str:
    """Output of a command. Ends the program if it fails."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, cwd=cwd)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


def check_metadata(wheel: Path) -> set[str]:
    """The Python versions that the classifiers promise. Ends the program if the metadata is invalid."""
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = Metadata.from_email(file.read(about), validate=True)
    if lost := re.findall(r"\]\((?!https?:)[^)]*\)", metadata.description or "]()"):
        sys.exit(f"the description has links that lead nowhere on PyPI: {', '.join(lost)}")
    unknown = set(metadata.classifiers or ()) - classifiers
    if unknown or "tci/py.typed" not in names or "tci/robot/robots/nao/robot.xml" not in names:
        sys.exit(f"unknown classifiers {unknown}, or files are missing in {wheel.name}")
    print(f"{metadata.name} {metadata.version}: metadata is valid, {len(names)} files")
    promised = re.compile(r"Programming Language :: Python :: (3\.\d+)")
    return {found[1] for one in metadata.classifiers or () if (found := promised.fullmatch(one))}


def check_install(python: str, sdist: Path, folder: Path) -> str:
    """Installs the sdist and runs the README's first program. Returns the version of Python."""
    version = say(python, "-c", VERSION)
    say(python, "-m", "venv", folder / version)
    there = folder / version / "bin" / "python"
    say(there, "-m", "pip", "install", "--quiet", sdist)
    program = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    (folder / "five_lines.py").write_text(program)
    said = say(there, "five_lines.py", cwd=folder)
    if not said.startswith("nao: touched left_forearm"):
        sys.exit(f"Python {version}: the README's program printed {said!r}")
    mypy = [sys.executable, "-m", "mypy", "--config-file=", "--python-executable", there]
    say(*mypy, "five_lines.py", cwd=folder)
    print(f"Python {version}: installed from {sdist.name}, typed, {said}")
    return version


def main() -> None:
    """Ends with a message at the first fault."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        say(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder / "dist", ROOT)
        (wheel,), (sdist,) = (folder / "dist").glob("*.whl"), (folder / "dist").glob("*.tar.gz")
        promised = check_metadata(wheel)
        tried = {check_install(python, sdist, folder) for python in sys.argv[1:] or [sys.executable]}
    if promised - tried:
        sys.exit(f"the classifiers promise Python {', '.join(sorted(promised - tried))}, which was not tried")


if __name__ == "__main__":
    main()
