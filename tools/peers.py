"""Install the Debian packages that the tests start as peers: requirements/debian.txt.

    python3 tools/peers.py

As root on Debian it installs what is missing. Elsewhere it says which tests will not run, and why: they
are named again at the end of the test run.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

LIST = Path(__file__).resolve().parent.parent / "requirements" / "debian.txt"


def packages() -> dict[str, str]:
    """What each package is for, by its name."""
    lines = [line.split(maxsplit=1) for line in LIST.read_text().splitlines()]
    return {line[0]: line[1] for line in lines if len(line) == 2 and not line[0].startswith("#")}


def missing() -> list[str]:
    """Packages that are not installed; all of them where there is no dpkg."""
    if shutil.which("dpkg-query") is None:
        return list(packages())
    found = []
    for name in packages():
        command = ["dpkg-query", "--show", "--showformat=${db:Status-Status}", name]
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        if answer.stdout != "installed":
            found.append(name)
    return found


def main() -> None:
    wanted = missing()
    if not wanted:
        return
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        for name in wanted:
            print(f"peer not installed: {name} ({packages()[name]}); as root: apt-get install {name}")
        return
    print(f"installing peers of the tests: {' '.join(wanted)}", flush=True)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    install = ["apt-get", "install", "--yes", "--quiet", "--no-install-recommends", *wanted]
    for command in (install, ["apt-get", "update", "--quiet"], install):
        # A fresh machine knows no package before its first update.
        quiet = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if command is install and quiet.returncode == 0:
            return
    raise SystemExit(f"can't install {' '.join(wanted)}:\n{quiet.stderr}")


if __name__ == "__main__":
    main()
