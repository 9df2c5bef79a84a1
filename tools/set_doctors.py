"""Shows sets of TCI to the programs that examine sets of LeRobot, and has genuine LeRobot edit one.

python tools/set_doctors.py [--rates 30,100,1000] [--out out/set_doctors] [--no-edits], in the environment of
`make lerobot`: robovet must say CLEAN, lerobot-doctor must pass five of its checks (the others warn of taxels
that nobody touched and of arms that rest), and after lerobot-edit-dataset has split, merged and deleted, each
skin frame of what remains must be there.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tci.datasets import read_lerobot

LEROBOT = Path(__file__).with_name("with_lerobot.py")
CHECKS = "metadata,temporal,videos,consistency,portability"
TOUCHES = (
    "push 'left forearm' 5N",
    "stroke 'right forearm' 3N",
    "tap 'left upper arm'",
    "poke 'left forearm'",
)


def program(name: str, *words: str | Path, home: Path | None = None) -> str:
    """What a program of this environment says. Raises SystemExit if it fails."""
    settings = {**os.environ, "COLUMNS": "200", "HF_LEROBOT_HOME": str(home), "HF_HUB_OFFLINE": "1"}
    command = [Path(sys.executable).with_name(name), *words]
    ran = subprocess.run(command, capture_output=True, text=True, env=settings, check=False)
    if ran.returncode:
        raise SystemExit(
            f"{name} {' '.join(map(str, words))}: status {ran.returncode}\n{ran.stdout}{ran.stderr}"
        )
    return ran.stdout + ran.stderr


def record(folder: Path) -> None:
    """Four touches of a NAO."""
    folder.mkdir(parents=True)
    for n, touch in enumerate(TOUCHES):
        words = ["--touch", touch, "--duration", "1.2", "--task", f"give way to a {touch.split()[0]}"]
        program("tci", "run", "withdrawal", "nao", *words, "--record", folder / f"{n}.mcap")


def examine(folder: Path, rate: int) -> None:
    said = program("robovet", "doctor", folder)
    if "CLEAN" not in said:
        raise SystemExit(said)
    program("lerobot-doctor", "check", folder, "--checks", CHECKS, "--ci", "--fail-on", "warn")
    print(f"{rate} rows per second: robovet says CLEAN, lerobot-doctor passes {CHECKS}", flush=True)


def frames(folder: Path) -> list[list[bytes]]:
    """The raw skin of each episode."""
    data = read_lerobot(folder)
    return [
        [frame.values.tobytes() for row in data.frames(number) for frame in row]
        for number in range(len(data.places))
    ]


def edit(home: Path) -> None:
    """`home`/tci/touch has four episodes."""
    before, sets = frames(home / "tci/touch"), home / "tci"

    def edited(*words: str) -> None:
        program("python", LEROBOT, "command", "edit", *words, "--push_to_hub=false", home=home)

    edited("--repo_id=tci/touch", "--operation.type=split", '--operation.splits={"a": [0, 1], "b": [2, 3]}')
    edited(
        "--repo_id=tci/again", "--operation.type=merge", "--operation.repo_ids=['tci/touch_b', 'tci/touch_a']"
    )
    words = ["--operation.type=delete_episodes", "--operation.episode_indices=[0, 2]"]
    edited("--repo_id=tci/touch", "--new_repo_id=tci/fewer", *words)
    expected = {"touch_a": [0, 1], "touch_b": [2, 3], "again": [2, 3, 0, 1], "fewer": [1, 3]}
    for name, which in expected.items():
        if frames(sets / name) != [before[n] for n in which]:
            raise SystemExit(f"{name}: its skin frames are not those of episodes {which}")
    count = sum(map(len, before))
    print(f"lerobot-edit-dataset split, merged and deleted: all of {count} skin frames are where they belong")


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--rates", default="30,100,1000")
    words.add_argument("--out", type=Path, default=Path("out/set_doctors"))
    words.add_argument("--no-edits", action="store_true")
    given = words.parse_args()
    out = given.out.resolve()
    shutil.rmtree(out, ignore_errors=True)
    record(out / "recordings")
    for rate in map(int, given.rates.split(",")):
        folder = out / "home" / "tci" / ("touch" if rate == 30 else f"touch-{rate}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        program("tci", "log", "export", out / "recordings", folder, "--format", "lerobot", "--fps", str(rate))
        examine(folder, rate)
    if not given.no_edits:
        edit(out / "home")


if __name__ == "__main__":
    main()
