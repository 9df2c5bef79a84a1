"""Creates the virtual environment `.venv` on a bare machine, and installs locked packages into it.

python3 tools/bootstrap.py REQUIREMENTS

The program uses only the standard library. Debian's python3 lacks ensurepip and pip. In this case the program
downloads a fixed version of pip from PyPI and checks its hash. pip installs uv, and uv all else. A second run
installs nothing.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import subprocess
import sys
import tempfile
import urllib.parse
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
PIP = VENV / "bin" / "pip"
"""File that is created last. If the file is missing, or the Python of the environment no longer exists, the
environment is created again."""
UV = VENV / "bin" / "uv"
UV_LOCK = ROOT / "requirements" / "uv.txt"
PIP_INDEX = "https://pypi.org/simple/pip/"
PIP_WHEEL = "pip-26.3-py3-none-any.whl"
PIP_SHA256 = "f3b60b20ffaadd4415ed7957212a38ac63fa4c5fa375bd0f4a797777940fad13"


def main() -> None:
    if sys.version_info < (3, 11):
        sys.exit(f"Python 3.11 or newer is needed, this is {sys.version.split()[0]}; set PYTHON=python3.11")
    lock = ROOT / sys.argv[1]
    stamp = VENV / f"{lock.stem}.installed"
    state = hashlib.sha256(lock.read_bytes() + (ROOT / "pyproject.toml").read_bytes()).hexdigest()
    whole = PYTHON.exists() and PIP.exists()
    if whole and stamp.exists() and stamp.read_text() == state:
        return
    if not whole:
        make_venv()
    if not UV.exists():
        pip_quietly = [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        wheel = ["--only-binary", ":all:", "--require-hashes", "--requirement", str(UV_LOCK)]
        subprocess.run([*pip_quietly, *wheel], check=False)
    print(f"installing {lock.relative_to(ROOT)} into .venv", flush=True)
    install(PYTHON, "--require-hashes", "--requirement", str(lock))
    pip("uninstall", "--yes", "tci")  # the name of the distribution until PyPI had it
    install(PYTHON, "--no-deps", "--no-build-isolation", "--editable", str(ROOT))
    stamp.write_text(state)


def install(python: Path, *arguments: str) -> None:
    """Installs into the environment of `python`: with uv, in a tenth of pip's time; with pip where uv can't,
    since it does not read pip's settings, such as an index of one's own."""
    quiet = [] if sys.stdout.isatty() else ["--quiet"]
    command = [str(UV), "pip", "install", "--system-certs", *quiet, "--python", str(python), *arguments]
    if UV.exists() and subprocess.run(command, cwd=ROOT, check=False).returncode == 0:
        return
    print("uv can't: installing with pip, which takes some minutes", flush=True)
    pip("--python", str(python), "install", *arguments)


def make_venv() -> None:
    print(f"making .venv with Python {sys.version.split()[0]}", flush=True)
    has_pip = importlib.util.find_spec("ensurepip") is not None
    command = [sys.executable, "-m", "venv", "--clear", *([] if has_pip else ["--without-pip"]), str(VENV)]
    subprocess.run(command, check=True)
    if not has_pip:
        fetch_pip()


def fetch_pip() -> None:
    print("this Python has no ensurepip: fetching pip from PyPI", flush=True)
    try:
        page = read(PIP_INDEX).decode()
        driver = re.search(rf'href="([^"#]*{re.escape(PIP_WHEEL)})', page)
        wheel = read(urllib.parse.urljoin(PIP_INDEX, driver[1])) if driver else b""
    except OSError as error:
        sys.exit(f"can't fetch pip ({error}); on Debian: apt-get install python3-venv ca-certificates")
    if hashlib.sha256(wheel).hexdigest() != PIP_SHA256:
        sys.exit(f"{PIP_INDEX} has no {PIP_WHEEL} with the expected hash; nothing was installed")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / PIP_WHEEL
        path.write_bytes(wheel)
        subprocess.run([str(PYTHON), f"{path}/pip", "install", "--no-index", str(path)], check=True)


def read(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=60) as answer:
        content: bytes = answer.read()
    return content


def pip(*arguments: str) -> None:
    """Runs pip. On a terminal, shows only the package that is being installed. After a failure, shows the
    whole output."""
    command = [str(PYTHON), "-m", "pip", "--disable-pip-version-check", *arguments]
    shown = sys.stdout.isatty()
    said: list[str] = []
    with subprocess.Popen(
        command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        for line in process.stdout or ():
            said.append(line)
            if shown and line.startswith(("Collecting", "Installing")):
                print(f"\r\033[K  {line[:70].rstrip()}", end="", flush=True)
    if shown:
        print("\r\033[K", end="")
    if process.returncode:
        sys.exit("".join([*said, "pip failed; the lines above say why"]))


if __name__ == "__main__":
    main()
