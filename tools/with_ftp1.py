"""Shows genuine FTP-1 with sets of Open-X-Tactile that TCI wrote: its ReplayBuffer opens them, episode by
episode, and finds what was recorded.

python tools/with_ftp1.py CLONE PYTHON [--robots nao-hands,g1-inspire] [--out out/ftp1]

CLONE is a folder with FTP-1's repository, PYTHON an interpreter with zarr 3 (`make ftp1` has both).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from tci.datasets.episodes import read_set
from tci.messages.frames import Array

FPS, TASK = 30, "Withdraw from the finger"
BUFFERS = ("src/openpi/replay_buffer.py", "data_processing/common/replay_buffer.py")
"""The buffer of FTP-1's training, and that of its conversions."""
READ = """
import importlib.util, sys
import numpy
spec = importlib.util.spec_from_file_location("replay_buffer", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
buffer, found = module.ReplayBuffer.create_from_path(sys.argv[2]), dict()
for episode in range(buffer.n_episodes):
    for key, values in buffer.get_episode(episode, copy=True).items():
        found[f"{episode}/{key}"] = numpy.asarray(values)
numpy.savez(sys.argv[3], **found)
"""


def write(robot: str, folder: Path) -> list[dict[str, Array]]:
    """Records two withdrawals, exports them to `folder`/set, and returns the columns of each episode."""
    tci = Path(sys.executable).with_name("tci")
    recordings = folder / "recordings"
    shutil.rmtree(folder, ignore_errors=True)
    recordings.mkdir(parents=True)
    files = [recordings / f"{k}.mcap" for k in range(2)]
    for file, seconds in zip(files, ("0.8", "1.2"), strict=True):
        poke = ["--poke", "--duration", seconds, "--record", file]
        subprocess.run([tci, "run", "withdrawal", robot, *poke], check=True, stdout=subprocess.DEVNULL)
    form = ["--format", "oxt", "--task", TASK, "--fps", str(FPS)]
    subprocess.run([tci, "log", "export", recordings, folder / "set", *form], check=True)
    data = read_set(files, fps=FPS)
    episodes = [list(data.blocks(episode)) for episode in data.episodes]
    return [{name: np.concatenate([b[name] for b in one]) for name in data.features} for one in episodes]


def compare(columns: dict[str, Array], found: dict[str, Array]) -> int:
    """How many numbers of the skin are equal. Raises AssertionError if one differs, or a patch is missing."""
    count = 0
    for name, values in columns.items():
        _, _, patch = name.partition("observation.tactile.")
        if patch:
            side, _, group = patch.partition("_")
            key = (
                f"{side}_tactile_data_{group}"
                if side in ("left", "right")
                else f"right_tactile_data_body_{patch}"
            )
            read = found[key].reshape(len(values), -1)
            assert np.array_equal(read, values), f"{key} differs"
            count += read.size
    assert count, "no skin"
    assert any(values.any() for key, values in found.items() if "_tactile_data_" in key), "nothing was felt"
    assert set(found["sub_task_instruction"]) == {TASK}
    return count


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("clone", type=Path)
    words.add_argument("python", type=Path)
    words.add_argument("--robots", default="nao-hands,g1-inspire")
    words.add_argument("--out", type=Path, default=Path("out/ftp1"))
    given = words.parse_args()
    for robot in given.robots.split(","):
        folder = given.out / robot
        episodes = write(robot, folder)
        for file in BUFFERS:
            store, kept = folder / "set" / "set.zarr", folder / "read.npz"
            subprocess.run([given.python, "-I", "-c", READ, given.clone / file, store, kept], check=True)
            with np.load(kept) as read:
                arrays = {name: read[name] for name in read.files}
            count = 0
            for number, columns in enumerate(episodes):
                begin = f"{number}/"
                own = {name.removeprefix(begin): a for name, a in arrays.items() if name.startswith(begin)}
                count += compare(columns, own)
            print(f"{robot}, {file}: {len(episodes)} episodes, {count} values of skin equal", flush=True)


if __name__ == "__main__":
    main()
