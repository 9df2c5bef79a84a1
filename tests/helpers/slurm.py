"""Slurm of Debian on one node, in a network namespace of its own: nobody else can reach its ports.

`in_slurm` runs a program beside it; the module itself is the program that runs in the namespace, as root:
python -m helpers.slurm FOLDER COMMAND...
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers import TESTS
from helpers.peers import needs_program

ADDRESS = "10.9.9.1"
"""With 127.0.0.1 Slurm's clients look for the host's name for minutes."""
CONF = """\
ClusterName=tci
SlurmctldHost={host}({address})
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/open/munge
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
ReturnToService=2
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
MailProg=/bin/true
NodeName={host} NodeAddr={address} CPUs=2 RealMemory=1000 State=UNKNOWN
PartitionName=short Nodes={host} Default=NO MaxTime=60 State=UP
"""


def needs_slurm() -> None:
    """Skips the test, with advice, without Slurm or the right to make a network namespace."""
    for name in ("slurmctld", "slurmd", "munged", "sbatch"):
        needs_program(name, "slurm-wlm")
    if subprocess.run(["unshare", "--net", "true"], capture_output=True, check=False).returncode:
        pytest.skip("did not run: needs network namespaces: as root, outside of a container")


def in_slurm(folder: Path, *command: str, timeout: float) -> subprocess.CompletedProcess[str]:
    """Runs a command beside a new Slurm, whose files are in `folder`."""
    return subprocess.run(
        ["unshare", "--net", sys.executable, "-m", "helpers.slurm", str(folder), *command],
        cwd=TESTS, capture_output=True, text=True, timeout=timeout, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])},
    )  # fmt: skip


def _start(folder: Path) -> list[subprocess.Popen[bytes]]:
    for words in (["link", "set", "lo", "up"], ["address", "add", f"{ADDRESS}/32", "dev", "lo"]):
        subprocess.run(["ip", *words], check=True)
    for name, rights in (("state", 0o755), ("spool", 0o755), ("munge", 0o700), ("open", 0o755)):
        (folder / name).mkdir(parents=True)
        (folder / name).chmod(rights)
    key, conf = folder / "munge" / "key", folder / "slurm.conf"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o400)
    conf.write_text(CONF.format(host=socket.gethostname(), address=ADDRESS, folder=folder))
    os.environ["SLURM_CONF"] = str(conf)
    files = [f"--{name}-file={folder}/munge/{name}" for name in ("key", "pid", "log", "seed")]
    socket_file = f"--socket={folder}/open/munge"
    running = [_run(folder, "munged", "--foreground", "--force", socket_file, "--num-threads=1", *files)]
    _until(lambda: (folder / "open" / "munge").exists())
    running += [_run(folder, "slurmctld", "-D"), _run(folder, "slurmd", "-D")]
    _until(lambda: "idle" in _said("sinfo", "--noheader", "--format=%T"))
    return running


def _run(folder: Path, name: str, *words: str) -> subprocess.Popen[bytes]:
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen([name, *words], stdout=log, stderr=log)


def _said(*command: str) -> str:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=False).stdout
    except subprocess.TimeoutExpired:
        return ""


def _until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            raise SystemExit("Slurm does not come up")
        time.sleep(0.2)


def main() -> int:
    folder, command = Path(sys.argv[1]), sys.argv[2:]
    running = _start(folder)
    try:
        return subprocess.run(command, check=False).returncode
    finally:
        for one in reversed(running):
            one.terminate()
            one.wait()


if __name__ == "__main__":
    raise SystemExit(main())
