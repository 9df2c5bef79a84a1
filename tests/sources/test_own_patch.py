"""The page about one's own patch: its files are written and its commands run in order, in an empty folder and
in a new environment, which has TCI's wheel, what that needs with the extra of the page, and nothing else."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from helpers import ROOT
from helpers.dds_domains import DOMAINS
from helpers.wheels import bare, build, install, lend_machine_code, needed_by, run

PAGE = (ROOT / "docs" / "own-patch.md").read_text()
FILE = re.compile(r"File `([\w.]+)`:\n\n```\w+\n(.*?)```", re.DOTALL)
SHELL = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def installed(folder: Path) -> Path:
    """The Python of a new environment with TCI and its extra `ros2`."""
    needed = needed_by("ros2")
    python, _ = bare(folder / "venv", lambda name: name in needed)
    install(python, build("wheel", ROOT, folder / "dist"))
    place = Path(run(python, "-c", "import tci; print(tci.__file__)").stdout.strip())
    assert place.is_relative_to(folder)
    lend_machine_code(place.parent)
    return python


@pytest.mark.timeout(300)
def test_ten_commands_lead_from_a_table_and_a_topic_to_a_reflex(tmp_path: Path) -> None:
    commands = [line for block in SHELL.findall(PAGE) for line in block.splitlines() if line]
    assert len(commands) <= 12
    script = ["set -m", "fail() { kill %1 2>/dev/null; exit 1; }"]
    script += [one if one.endswith("&") else f"echo '$ {n}'; {one} || fail" for n, one in enumerate(commands)]
    script.insert(4, f"cp {tmp_path}/files/* .")  # the page's files belong into the folder of command 2
    (tmp_path / "files").mkdir()
    files = FILE.findall(PAGE)
    assert [name for name, _ in files] == ["make_patch.py", "my_nao.xml", "publish.py"]
    for name, text in files:
        (tmp_path / "files" / name).write_text(text)
    home = tmp_path / "home"
    home.mkdir()
    fresh = {
        "PATH": f"{installed(tmp_path).parent}:{os.defpath}", "HOME": str(home), "COLUMNS": "200",
        "ROS_DOMAIN_ID": str(next(DOMAINS)),
    }  # fmt: skip
    ran = subprocess.run(["bash", "-c", "\n".join(script)], cwd=tmp_path, env=fresh, capture_output=True,
                         text=True, check=False, timeout=280)  # fmt: skip
    assert ran.returncode == 0, ran.stdout + ran.stderr
    said = re.split(r"^\$ (\d+)$", ran.stdout, flags=re.MULTILINE)
    by = {int(number): text for number, text in zip(said[1::2], said[2::2], strict=True)}
    folder = tmp_path / "my_robot"
    assert len((folder / "patch.csv").read_text().splitlines()) == 65
    assert (folder / "patch.png").stat().st_size > 5000
    simulated, doctor, run = by[5], by[7], by[8]
    assert "touched my_patch" in simulated
    assert re.search(r"moved .*RShoulder", simulated)
    assert "1 of 1 pads send" in doctor
    assert f"std_msgs/msg/Float32MultiArray in ROS domain {fresh['ROS_DOMAIN_ID']}" in doctor
    assert "touched my_patch" in run
    assert re.search(r"moved .*RShoulder", run)
