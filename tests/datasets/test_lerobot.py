"""A set of LeRobot is judged with PyArrow and JSON alone, by the rules of LeRobot's format v3.0."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from helpers.command_line import tci
from helpers.recorded import record_poke
from tci.datasets.episodes import read_set
from tci.datasets.lerobot import read_lerobot, write_lerobot
from tci.datasets.statistics import KEPT, Statistics
from tci.errors import RecordingError
from tci.recording.recorder import Recorder
from tci.recording.recording import Recording


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    record_poke(folder / "a.mcap", duration=0.5)
    record_poke(folder / "b.mcap", duration=0.8)
    return folder


@pytest.mark.parametrize("fps", [7, 30, 100, 1000])
def test_no_bit_of_the_raw_skin_differs_at_any_rate(fps: int, recordings: Path, tmp_path: Path) -> None:
    files = sorted(recordings.glob("*.mcap"))
    write_lerobot(read_set(files, fps=fps), tmp_path / "set")
    table = parquet.read_table(sorted((tmp_path / "set").glob("data/*/*.parquet"))[0])
    features = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    names = sorted({frame.patch for frame in Recording(files[0]).frames()})
    assert "left_forearm" in names
    episodes = table["episode_index"].to_numpy()
    for number, file in enumerate(files):
        rows = table.filter(episodes == number)
        sent = [frame for frame in Recording(file).frames() if frame.patch == "left_forearm"]
        counts = rows["observation.tactile_count.left_forearm"].to_pylist()
        raw = rows["observation.tactile_raw.left_forearm"].combine_chunks().flatten().to_numpy()
        slots = features["observation.tactile_stamp_ns.left_forearm"]["shape"][0]
        raw = raw.reshape(len(rows), slots, -1)
        kept = np.concatenate([some[:count] for some, count in zip(raw, counts, strict=True)])
        assert kept.tobytes() == np.stack([frame.values for frame in sent]).tobytes()
        assert kept.dtype == sent[0].values.dtype
        assert kept.any()
    again = [
        f for item in read_lerobot(tmp_path / "set").frames(1) for f in item if f.patch == "left_forearm"
    ]
    assert [f.values.tobytes() for f in again] == [f.values.tobytes() for f in sent]
    assert [f.stamp for f in again] == pytest.approx([f.stamp for f in sent], abs=2e-9)


def test_metadata_agree_with_the_data(recordings: Path, tmp_path: Path) -> None:
    tci("log", "export", str(recordings), str(tmp_path / "set"), "-f", "lerobot", "--task", "yield")
    folder = tmp_path / "set"
    info = json.loads((folder / "meta/info.json").read_text())
    stats = json.loads((folder / "meta/stats.json").read_text())
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet")
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, len(table), 30)
    episodes = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["tasks"] for row in episodes] == [["yield"], ["yield"]]
    assert set(table.column_names) == set(info["features"]) == set(stats)
    for name, feature in info["features"].items():
        column = table[name].combine_chunks()
        size = feature["shape"][0]
        assert (column.type.list_size if size > 1 else 1) == size
        flat = column.flatten() if size > 1 else column
        values = flat.to_numpy().astype(float).reshape(len(table), size)
        assert flat.type == feature["dtype"].replace("float32", "float")
        assert np.isfinite(values).all()
        for what in ("min", "max", "mean", "std"):
            assert np.allclose(stats[name][what], getattr(values, what)(axis=0), rtol=1e-6, atol=1e-6), name
        for row in episodes:
            own = values[row["dataset_from_index"] : row["dataset_to_index"]]
            assert np.allclose(row[f"stats/{name}/mean"], own.mean(axis=0), rtol=1e-6, atol=1e-6), name
    forces = np.stack(table["observation.environment_state"].to_pylist())
    action, state = (np.stack(table[name].to_pylist()) for name in ("action", "observation.state"))
    assert forces.max() > 1.0
    assert 0.01 < np.abs(action - state).max() < 0.2  # what was sent leads what was measured
    layout = parquet.read_table(folder / "meta/tci/left_forearm.parquet")
    assert len(layout) == info["features"]["observation.tactile.left_forearm"]["shape"][0]


def test_a_set_for_training_has_the_columns_that_are_asked_for(recordings: Path, tmp_path: Path) -> None:
    """LeRobot's loader reads all columns of a row, used or not."""
    export = ("log", "export", str(recordings / "a.mcap"), str(tmp_path / "set"), "-f")
    assert "valid: observation.state, action," in tci(*export, "lerobot", "--columns", "smell", status=1)
    assert "valid: for --format lerobot" in tci(*export, "oxt", "--columns", "action", status=1)
    tci(*export, "lerobot", "--columns", "observation.state, action")
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    assert table.column_names[:3] == ["observation.state", "action", "timestamp"]
    assert set(table.column_names) == set(json.loads((tmp_path / "set/meta/stats.json").read_text()))
    whole = read_set([recordings / "a.mcap"])
    write_lerobot(whole, tmp_path / "whole")
    for name in ("observation.state", "action"):
        expected = read_lerobot(tmp_path / "whole").episode(0)[name]
        np.testing.assert_array_equal(read_lerobot(tmp_path / "set").episode(0)[name], expected)


def test_a_set_becomes_a_recording_again(recordings: Path, tmp_path: Path) -> None:
    write_lerobot(read_set(sorted(recordings.glob("*.mcap"))), tmp_path / "set")
    out = tmp_path / "b.mcap"
    said = tci("log", "import", str(tmp_path / "set"), str(out), "nao", "--episode", "1", "--json")
    assert "action" in json.loads(said)["left_out"]
    frames = {patch: [] for patch in ("left_forearm", "right_forearm")}
    for file in (recordings / "b.mcap", out):
        for patch, found in frames.items():
            found.append([f.values.tobytes() for f in Recording(file).frames() if f.patch == patch])
    assert all(one == other for one, other in frames.values())
    with pytest.raises(RecordingError, match="episode 2; valid: 0 to 1"):
        read_lerobot(tmp_path / "set").episode(2)


def test_recordings_that_make_no_set(recordings: Path, tmp_path: Path) -> None:
    with Recorder(tmp_path / "g1.mcap", "icub"):
        pass
    with pytest.raises(RecordingError, match="one robot per set"):
        read_set([recordings / "a.mcap", tmp_path / "g1.mcap"])
    with pytest.raises(RecordingError, match="no periods"):
        read_set([tmp_path / "g1.mcap"])
    (tmp_path / "set").mkdir()
    with pytest.raises(RecordingError, match="not replaced"):
        write_lerobot(read_set([recordings / "a.mcap"]), tmp_path / "set")
    with pytest.raises(RecordingError, match="no data set of LeRobot"):
        read_lerobot(tmp_path)


@pytest.mark.parametrize(
    ("version", "pictures"),
    [("0.4.4", {"front: image", "wrist: video"}), ("0.6.1", {"front: image"})],
)
def test_a_set_that_lerobot_wrote_is_read(version: str, pictures: set[str]) -> None:
    """LeRobot itself wrote these sets (`create`, `add_frame`, `finalize`), with at most 1 kB per file.

    Row i of episode e counts k = 10 e + i.
    """
    data = read_lerobot(Path(__file__).parent / f"lerobot_{version}")
    assert (data.fps, data.robot_type, data.tasks) == (10, "arm", ("push", "pull"))
    left_out = {"note: string is not read"} | {f"observation.images.{one} is not read" for one in pictures}
    assert set(data.left_out) == left_out
    assert data.features["observation.state"].names == ("shoulder", "elbow")
    assert data.features["observation.force"].names is None  # genuine names are those of the two axes
    assert len({path for path, _, _ in data.places}) == 2
    for episode, rows in enumerate((3, 4)):
        k = 10 * episode + np.arange(rows)
        expected = {
            "observation.state": np.column_stack([k / 7, -k]).astype(np.float32),
            "observation.force": (k[:, None] + np.arange(6)).astype(np.float32),
            "observation.raw": np.column_stack([k, 255 - k, np.full(rows, 7)]).astype(np.uint8),
            "next.done": np.arange(rows)[:, None] == rows - 1,
            "task_index": np.full((rows, 1), episode),
        }
        columns = data.episode(episode)
        for name, values in expected.items():
            assert columns[name].dtype == values.dtype, name
            assert np.array_equal(columns[name], values), name
    with pytest.raises(RecordingError, match="no raw skin frames"):
        next(data.frames(0))


def test_statistics_of_blocks_are_those_of_the_whole() -> None:
    rng = np.random.default_rng(0)
    rows = 1.7e18 + rng.normal(scale=1e9, size=(5 * KEPT, 2))  # times in nanoseconds
    whole, other = Statistics(), Statistics()
    for block in np.array_split(rows[:KEPT], 7):
        whole.add(block)
    for block in np.array_split(rows[KEPT:], 31):
        other.add(block)
    whole.merge(other)
    found = whole.result()
    assert np.allclose(found["std"], rows.std(axis=0), rtol=1e-6)  # a float near 1.7e18 has steps of 256
    assert found["count"].tolist() == [len(rows)]
    for name, share in {"q01": 0.01, "q50": 0.5, "q99": 0.99}.items():
        exact = np.quantile(rows, share, axis=0)
        assert np.all(np.abs(found[name] - exact) < 0.15e9), name


def test_the_task_of_a_recording_is_that_of_its_episode(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    words = ("--duration", "0.1", "--json")
    tci("run", "withdrawal", "nao", *words, "--record", str(folder / "a.mcap"), "--task", "pull back")
    tci("record", str(folder / "b.mcap"), "nao", *words, "--task", "rest")
    tci("record", str(folder / "c.mcap"), "nao", *words)
    tci("log", "export", str(folder), str(tmp_path / "set"), "--format", "lerobot", "--task", "else")
    assert read_lerobot(tmp_path / "set").tasks == ("pull back", "rest", "else")
