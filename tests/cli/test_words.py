"""`tci words`: what a robot can tell, and a recogniser trained on labelled recordings."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copy

import tci
from helpers.command_line import tci as command
from tci.capabilities import TouchWords

LISTENS = "tci.capabilities.touch_words.capability:TouchWords"


def test_people_train_it_on_their_own_recordings(tmp_path: Path) -> None:
    visit, labels, mine = (str(tmp_path / name) for name in ("visit.mcap", "visit.tsv", "mine.npz"))
    touches = ("--touch", "press 'left forearm' 10N 0.6s", "--touch", "tap 'right forearm' 3N 0.1s")
    run = ("run", LISTENS, "nao", *touches, "--duration", "3.2", "--record", visit, "--json")
    command(*run)
    assert "no labels; valid: visit.tsv beside it" in command("words", "train", mine, visit, status=1)
    command("log", "touches", visit, labels)
    text = Path(labels).read_text()
    # what is felt is a guess; people write what it was
    rows = text.splitlines()
    assert len(rows) == 3
    Path(labels).write_text("\n".join([rows[0], *(_renamed(row) for row in rows[1:])]) + "\n")
    made = json.loads(command("words", "train", mine, visit, "--json"))
    assert made["touches"] == {"press": 1, "pat": 1}
    assert made["right_when_left_out"] == {}
    assert "exists; valid: a new file" in command("words", "train", mine, visit, status=1)
    known = json.loads(command("words", "show", "nao", "--recogniser", mine, "--json"))["words"]
    assert sorted(known["left_forearm"]) == ["pat", "press"]
    assert TouchWords(mine).words_on("left_hand", tci.GenericBody("nao")) == ("tap", "press")
    two = [str(tmp_path / f"{word}.mcap") for word in ("press", "pat")]
    for file in two:  # one word in each
        copy(visit, file)
        word = Path(file).stem
        lines = [row.split("\t") for row in rows[1:]]
        named = ["\t".join([*cells[:2], word, *cells[3:]]) for cells in lines]
        Path(file).with_suffix(".tsv").write_text("\n".join([rows[0], *named]) + "\n")
    said = command("words", "train", str(tmp_path / "two.npz"), *two)
    assert "without any one of these files no two words are left" in " ".join(said.split())
    assert "nowhere.mcap: no such file" in command(
        "words", "train", str(tmp_path / "none.npz"), "nowhere.mcap", status=1
    )
    assert "valid: a .npz file" in command("words", "train", str(tmp_path / "mine.txt"), visit, status=1)
    assert "nothing to train on" in command("words", "train", str(tmp_path / "none.npz"), status=1)


def _renamed(row: str) -> str:
    cells = row.split("\t")
    return "\t".join([*cells[:2], "pat" if "right forearm" in row else "press", *cells[3:]])
