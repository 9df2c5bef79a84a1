"""Program for tests: runs commands of `tci` as if some modules and distributions were not installed.

python bare_install.py HIDDEN[,HIDDEN...] reads a JSON list of commands (lists of words) from stdin, and
prints [status, output] of each command.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import json
import sys
import traceback
from typing import Any

HIDDEN = set(sys.argv[1].split(","))


class Blind:
    """An import finder that does not find the hidden modules and distributions."""

    def __init__(self, finder: Any) -> None:
        self.finder = finder

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        return None if name in HIDDEN else self.finder.find_spec(name, path, target)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.finder, name)


genuine = importlib.metadata.distribution


def distribution(name: str) -> importlib.metadata.Distribution:
    if name in HIDDEN:
        raise importlib.metadata.PackageNotFoundError(name)
    return genuine(name)


def run(words: list[str]) -> tuple[object, str]:
    from tci.cli.main import main

    sys.argv = ["tci", *words]
    said = io.StringIO()
    status: object = 0
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            main()
        except SystemExit as end:
            status = end.code
        except Exception:
            status = "raised"
            traceback.print_exc()
    return status, said.getvalue()


sys.meta_path[:] = [Blind(finder) for finder in sys.meta_path]
importlib.metadata.distribution = distribution
json.dump([run(words) for words in json.load(sys.stdin)], sys.stdout)
