from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skin_data import SkinData
from tci.errors import RecordingError
from tci.recording.recording import Recording
from tci.recording.yarp_log import import_yarp_log


@pytest.mark.parametrize("number", ["01", "08"])
def test_a_log_of_an_icubs_foot_keeps_every_value_and_time(
    number: str, tmp_path: Path, skin_data: SkinData
) -> None:
    log = skin_data.file(f"recordings/icub_right_foot_raw_{number}.log")
    rows = np.loadtxt(log)
    assert import_yarp_log(log, tmp_path / "foot.mcap", patch="right_foot") == len(rows)
    frames = list(Recording(tmp_path / "foot.mcap").frames())
    np.testing.assert_array_equal([frame.sequence for frame in frames], rows[:, 0])
    np.testing.assert_array_equal([frame.stamp for frame in frames], rows[:, 1])
    np.testing.assert_array_equal([frame.values for frame in frames], rows[:, 2:])
    assert (tmp_path / "foot.mcap").stat().st_size < log.stat().st_size


def test_a_folder_of_the_dumper_and_a_log_that_is_no_skin(tmp_path: Path) -> None:
    (tmp_path / "data.log").write_text("1 10.5 1 2 3\n\n2 10.6 4 5 6\n")
    assert import_yarp_log(tmp_path, tmp_path / "a.mcap", patch="p") == 2
    for text, match in (
        ("", "empty"), ("1 2.0 ((4 5))\n", "line 1"), ("1 2.0 1\n1 nan 1\n", "line 2"), ("1\n", "line 1"),
        ("1 2.0\n", "line 1"), ("-1 2.0 1\n", "line 1"), ("1 2.0 " + "1 " * 2**20, "longer"),
    ):  # fmt: skip
        (tmp_path / "data.log").write_text(text)
        with pytest.raises(RecordingError, match=match):
            import_yarp_log(tmp_path, tmp_path / "b.mcap", patch="p")
    assert [path.name for path in tmp_path.glob("*.mcap*")] == ["a.mcap"]
