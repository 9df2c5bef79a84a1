"""Checks the README's programs and all examples as a user's editor does, with mypy and pyright.

Neither may find an error, and no line may switch a check off.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
OFF = re.compile(r"#\s*(?:type:|pyright:|mypy:|noqa)")
MYPY = (
    "--config-file=", "--check-untyped-defs", "--warn-return-any", "--warn-unreachable",
    "--no-implicit-reexport", "--disable-error-code=import-untyped",  # pandas and matplotlib publish no types
)  # fmt: skip


def programs() -> dict[str, str]:
    """The programs of the README and the examples, by a name for each."""
    shown = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    examples = {f"example_{path.name}": path.read_text() for path in sorted(ROOT.glob("examples/*.py"))}
    return {f"readme_{number}.py": program for number, program in enumerate(shown)} | examples


def main() -> int:
    """Prints what the checkers say. Returns 1 if they find an error."""
    found = programs()
    switched = [name for name, program in found.items() if OFF.search(program)]
    for name in switched:
        print(f"{name}: a comment switches a check off")
    scripts = Path(sysconfig.get_path("scripts"))
    with TemporaryDirectory() as folder:
        for name, program in found.items():
            (Path(folder) / name).write_text(program)
        settings = {"typeCheckingMode": "standard", "extraPaths": [str(ROOT / "src")]}
        (Path(folder) / "pyrightconfig.json").write_text(json.dumps(settings))
        commands = (
            [sys.executable, "-m", "mypy", *MYPY, f"--cache-dir={ROOT / '.mypy_cache' / 'user'}", *found],
            [scripts / "basedpyright", "--pythonpath", sys.executable],
        )
        paths = {**os.environ, "MYPYPATH": str(ROOT / "src")}
        failed = [subprocess.run(one, cwd=folder, env=paths, check=False).returncode for one in commands]
    return int(bool(switched) or any(failed))


if __name__ == "__main__":
    sys.exit(main())
