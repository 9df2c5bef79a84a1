"""The import of a contact list reports which skin file (table of taxel positions) was used for the
recording."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from helpers.command_line import tci
from helpers.skin_data import SkinData
from tci.recording.contact_list import import_contact_list
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot
from tci.robot.description import Table


def test_the_recorded_centres_tell_which_table_was_used(tmp_path: Path, skin_data: SkinData) -> None:
    log, tables = skin_data.file("recordings/icub_skin_events.log"), skin_data.file("icub/positions")
    out = str(tmp_path / "a.mcap")
    told = json.loads(tci("log", "import", str(log), out, "icub", "--tables", str(tables), "--json"))
    parts = {part["part"]: part for part in told["parts"]}
    for part, table in {
        "left_forearm": "left_forearm_mesh.txt", "right_forearm": "right_forearm_mesh.txt",
        "left_hand": "left_hand_V2_1.txt", "right_hand": "right_hand_V2_1.txt",
        "right_arm": "right_arm_mesh.txt",
    }.items():  # fmt: skip
        assert table in parts[part]["tables"]
        # The made skin files of the two versions of a part are equal.
        assert len(parts[part]["tables"]) == 1 or not skin_data.genuine
    assert parts["torso"]["tables"] == skin_data.expect(made=["torso.txt"], genuine=[])
    # The packaged forearm has the second version of the skin. The recorded robot had the first version.
    assert [parts[part]["verdict"] for part in ("left_forearm", "left_hand")] == ["wrong", "no patch"]
    assert parts["left_forearm"]["off_mm"] > 1.0
    assert "left_forearm was recorded with another table" in Recording(tmp_path / "a.mcap").about["source"]
    words = tci("log", "import", str(log), str(tmp_path / "b.mcap"), "icub")
    assert "contacts are on the wrong places" in words


@pytest.mark.parametrize(("file", "verdict"), [("left_forearm_mesh", "fits"), ("left_foot", "wrong")])
def test_a_robot_with_the_recorded_table_fits_in_any_frame(
    file: str, verdict: str, tmp_path: Path, skin_data: SkinData
) -> None:
    icub = load_robot("icub")
    path = str(skin_data.file(f"icub/positions/{file}.txt"))
    forearm = icub.patch("left_forearm").model_copy(
        update={"surface": Table(file=path, format="icub", xyz=(0.1, 0.0, 0.03), rpy=(0.0, 1.3, 0.0))}
    )
    robot = icub.model_copy(update={"patches": (forearm,)})
    log = skin_data.file("recordings/icub_skin_events.log")
    done = import_contact_list(log, tmp_path / "a.mcap", robot)
    assert {part.part: part.verdict for part in done.parts}["left_forearm"] == verdict


def test_a_contact_list_needs_a_robot(tmp_path: Path, skin_data: SkinData) -> None:
    log, out = str(skin_data.file("recordings/icub_skin_events.log")), str(tmp_path / "a.mcap")
    assert "valid: tci log import" in tci("log", "import", log, out, status=1)
