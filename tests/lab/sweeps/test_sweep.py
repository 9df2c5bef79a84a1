"""Sweeps: equal numbers whatever the processes, shards, order and interruptions, and on a scheduler."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from helpers.command_line import tci
from helpers.slurm import in_slurm, needs_slurm
from tci.errors import CommandError, MissingExtraError
from tci.lab.sweeps.cluster import submit
from tci.lab.sweeps.sweep import Shard, Sweep
from tci.lab.sweeps.touch_trials import TouchTrials

TRIALS = 4
WORDS = "withdrawal", "nao", "--trials", str(TRIALS), "--kind", "tap", "--kind", "poke"


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The table of all trials, by one process."""
    folder = tmp_path_factory.mktemp("alone")
    tci("sweep", *WORDS, "--workers", "1", "--out", str(folder))
    return (folder / "trials.csv").read_text()


def needs_submitit() -> None:
    if importlib.util.find_spec("submitit") is None:
        pytest.skip("did not run: needs submitit; to get it: make dev-env")


def test_numbers_are_equal_whatever_the_processes_shards_and_order(alone: str, tmp_path: Path) -> None:
    asked = TouchTrials("withdrawal", "nao", ("tap", "poke")).sweep(tmp_path, TRIALS)
    asked.run(shard=Shard.parse("3/3"), workers=1)
    asked.run(shard=Shard(2, 3), workers=2)
    told = tci("sweep", *WORDS, "--merge", "--out", str(tmp_path), status=1)
    assert "2 of 4 trials are not in" in told
    tci("sweep", *WORDS, "--shard", "1/3", "--workers", "2", "--out", str(tmp_path))
    said = json.loads(tci("sweep", *WORDS, "--merge", "--out", str(tmp_path), "--json"))
    assert said["trials"] == TRIALS
    assert (tmp_path / "trials.csv").read_text() == alone
    table = [*csv.DictReader(alone.splitlines())]
    assert len({row["felt_N"] for row in table}) > 1, "every trial is another one"


class Stopped(Exception):
    pass


def stop_after(done: int, of: int) -> None:
    if done > 4:
        raise Stopped


def slow(number: int) -> dict[str, float]:
    time.sleep(0.01)
    return {"pid": os.getpid(), "square": number**2}


def test_what_is_kept_is_not_done_again_and_a_torn_line_is(tmp_path: Path) -> None:
    asked = Sweep(tmp_path, slow, [(number,) for number in range(8)], "one")
    with pytest.raises(Stopped):
        asked.run(workers=1, progress=stop_after)
    file = tmp_path / "1-of-1.jsonl"
    before = file.read_text()
    assert before.count("\n") == 5
    file.write_text(before[:-20])  # as a process leaves it that is killed while it writes
    asked.run(workers=2)
    assert file.read_text().startswith(before[:-20])
    assert [one["square"] for one in asked.results()] == [number**2 for number in range(8)]
    assert [one["pid"] == os.getpid() for one in asked.results()] == [True] * 4 + [False] * 4
    more = Sweep(tmp_path / "more", slow, [(number,) for number in range(200)], "one")
    with pytest.raises(Stopped):
        more.run(workers=2, progress=stop_after)
    assert 5 <= len(more.results()) < 100, "what has not begun is left out"
    other = Sweep(tmp_path, slow, asked.jobs, "other")
    assert not other.results(), "results of other settings don't count"
    assert other.missing_shards(3) == [Shard(1, 3), Shard(2, 3), Shard(3, 3)]
    assert not asked.missing_shards(3)


def never(number: int) -> dict[str, float]:
    return {"told": float("inf")}


def test_a_number_may_be_infinite(tmp_path: Path) -> None:
    """As the bound of a reflex that told none."""
    asked = Sweep(tmp_path, never, [(1,)], "one")
    asked.run()
    assert asked.results() == [{"told": float("inf")}]


@pytest.mark.parametrize("text", ["0/3", "4/3", "1/0", "3", "a/b", "-1/3"])
def test_a_wrong_shard_is_told_with_the_valid_ones(text: str) -> None:
    with pytest.raises(CommandError, match="valid: "):
        Shard.parse(text)


def test_a_cluster_without_submitit_or_scheduler_is_told(tmp_path: Path, monkeypatch: Any) -> None:
    asked = Sweep(tmp_path, slow, [(1,)], "one")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "submitit", None)
        with pytest.raises(MissingExtraError, match="cluster"):
            submit(asked, 1)
    needs_submitit()
    with pytest.raises(CommandError, match=r"nothing: .*nothing"):
        submit(asked, 1, cluster="nothing")
    with pytest.raises(CommandError, match="slurm_colour"):
        submit(asked, 1, cluster="local", options={"colour": "red"})


def fails_once(number: int, folder: str) -> dict[str, int]:
    mark = Path(folder) / "tried"
    if number == 2 and not mark.exists():
        mark.touch()
        raise ValueError("the first time")
    return {"number": number}


def test_a_shard_that_fails_is_told_and_the_next_array_does_only_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs_submitit()
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # the tasks import this file
    asked = Sweep(tmp_path / "kept", fails_once, [(number, str(tmp_path)) for number in range(4)], "one")
    array = submit(asked, 2, cluster="local")
    with pytest.raises(
        CommandError, match=r"1 of 2 shards failed: 1/2: ValueError: the first time \(.*err\)"
    ):
        array.wait()
    assert [one["number"] for one in asked.results()] == [0, 1, 3]
    again = submit(asked, 2, cluster="local")
    assert [*again.tasks] == [Shard(1, 2)]
    again.wait()
    assert [one["number"] for one in asked.results()] == [0, 1, 2, 3]


def test_an_array_of_the_local_executor_finds_the_same(alone: str, tmp_path: Path) -> None:
    needs_submitit()
    tci("sweep", *WORDS, "--cluster", "local", "--shards", "2", "--out", str(tmp_path))
    assert (tmp_path / "trials.csv").read_text() == alone
    assert {path.name for path in tmp_path.glob("*.jsonl")} == {"1-of-2.jsonl", "2-of-2.jsonl"}


def test_an_array_of_slurm_finds_the_same(alone: str, tmp_path: Path) -> None:
    needs_submitit()
    needs_slurm()
    out = tmp_path / "out"
    done = in_slurm(
        tmp_path / "slurm", sys.executable, "-m", "tci.cli.main", "sweep", *WORDS, "--cluster", "slurm",
        "--shards", "2", "--slurm", "partition=short", "--slurm", "mem=400M", "--out", str(out),
        timeout=200.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert (out / "trials.csv").read_text() == alone
    scripts = [path.read_text() for path in (out / "tasks").glob("*.sh")]
    assert any("#SBATCH --array=0-1" in script and "partition=short" in script for script in scripts)
