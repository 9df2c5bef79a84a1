"""Installs the programs with which the tests exchange data: Debian packages of requirements/debian.txt, a
virtual environment `.peers/NAME` for each requirements/peers/NAME.txt, Node's packages for
NAME/package-lock.json.

python3 tools/peers.py

As root on Debian the program installs everything that is missing. On other systems it prints the tests that
will not run, with the reason. The test run lists these tests again at its end.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import bootstrap

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "requirements" / "debian.txt"
PEERS = ROOT / "requirements" / "peers"


def packages() -> dict[str, str]:
    """Returns the purpose of each package, by its name."""
    lines = [line.split(maxsplit=1) for line in LIST.read_text().splitlines()]
    return {line[0]: line[1] for line in lines if len(line) == 2 and not line[0].startswith("#")}


def missing() -> list[str]:
    """Returns the packages that are not installed. On a system without dpkg, returns all packages."""
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
    install_debian()
    for lock in sorted(PEERS.glob("*.txt")):
        install_python(lock)
    for lock in sorted(PEERS.glob("*/package-lock.json")):
        install_node(lock)


def install_python(lock: Path) -> None:
    """Installs the packages of a lock file in a separate virtual environment, unless the environment is up to
    date."""
    folder = ROOT / ".peers" / lock.stem
    stamp = folder / "installed"
    state = hashlib.sha256(lock.read_bytes()).hexdigest()
    if stamp.exists() and stamp.read_text() == state:
        return
    print(f"installing {lock.relative_to(ROOT)} into {folder.relative_to(ROOT)}", flush=True)
    own = str(ROOT / ".venv" / "bin" / "python")
    subprocess.run([own, "-m", "venv", "--clear", "--without-pip", str(folder)], check=True)
    alone = ["--no-deps"] if lock.with_suffix(".in").read_text().startswith("# alone") else []
    bootstrap.install(folder / "bin" / "python", *alone, "--require-hashes", "--requirement", str(lock))
    stamp.write_text(state)


def install_node(lock: Path) -> None:
    """Installs the packages of npm's lock file in a separate folder, unless the folder is up to date.

    npm and node come from PyPI, since Debian's npm depends on more than 300 packages.
    """
    folder = ROOT / ".peers" / lock.parent.name
    stamp = folder / "installed"
    state = hashlib.sha256(lock.read_bytes()).hexdigest()
    if stamp.exists() and stamp.read_text() == state:
        return
    print(f"installing {lock.relative_to(ROOT)} into {folder.relative_to(ROOT)}", flush=True)
    folder.mkdir(parents=True, exist_ok=True)
    for file in (lock, lock.with_name("package.json")):
        shutil.copy(file, folder)
    node = ROOT / ".peers" / "node" / "bin"
    command = [str(node / "npm"), "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"]
    paths = os.pathsep.join((str(node), os.environ["PATH"]))
    # Without this variable Node does not use the certificates of the system, which a network with a proxy
    # requires.
    environment = {**os.environ, "PATH": paths, "NODE_OPTIONS": "--use-system-ca"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"can't install {lock.relative_to(ROOT)}:\n{done.stdout}{done.stderr}")
    stamp.write_text(state)


def install_debian() -> None:
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
        # A newly installed Debian has no list of packages before its first update.
        quiet = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if command is install and quiet.returncode == 0:
            return
    raise SystemExit(f"can't install {' '.join(wanted)}:\n{quiet.stderr}")


if __name__ == "__main__":
    main()
