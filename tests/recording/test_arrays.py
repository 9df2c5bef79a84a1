"""Taxel frames are imported from the arrays of other programs, with a mapping file."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from helpers.command_line import tci
from tci.drivers.registry import connect
from tci.errors import DescriptionError, RecordingError, TciError
from tci.recording.arrays import LARGEST, import_arrays
from tci.recording.recording import Recording
from tci.robot.catalogue import load_robot

TIMES = np.arange(50) * 10.0
VALUES = np.random.default_rng(0).integers(0, 4096, (50, 4, 60)).astype(np.uint16)
PLAIN = '[skin.left_forearm]\nvalues = "p"\n'


def written(folder: Path, suffix: str) -> tuple[Path, Path]:
    """Writes VALUES with times [ms] in one kind of file, as other programs do, and writes the mapping."""
    file, mapping = folder / f"frames{suffix}", folder / "map.toml"
    words = 'time = "t"\nseconds = 0.001\n' + PLAIN
    if suffix == ".npz":
        np.savez_compressed(file, t=TIMES, p=VALUES)
    elif suffix == ".mat":
        savemat(file, {"t": TIMES, "p": np.moveaxis(VALUES, 0, 2)}, do_compression=True)
        words += "axis = -1\n"
    else:
        head = ",".join(["note", "t", *(f"c{k}" for k in range(240))])
        rows = np.column_stack([TIMES, VALUES.reshape(50, -1)])
        file.write_text("\n".join([head, *("1," + ",".join(map(str, row)) for row in rows)]))
        words = words.replace('"p"', '"c0:c239"')
    mapping.write_text(words)
    return file, mapping


@pytest.mark.parametrize("suffix", [".npz", ".mat", ".csv"])
def test_every_value_and_time_is_kept(suffix: str, tmp_path: Path) -> None:
    file, mapping = written(tmp_path, suffix)
    out = tmp_path / "a.mcap"
    assert "50 frames" in tci("log", "import", str(file), str(out), "nao", "--map", str(mapping))
    recording = Recording(out)
    assert recording.about["robot"] == "nao"
    assert recording.period == pytest.approx(0.01)
    frames = list(recording.frames())
    assert {frame.patch for frame in frames} == {"left_forearm"}
    np.testing.assert_array_equal([frame.stamp for frame in frames], TIMES * 0.001)
    np.testing.assert_array_equal([frame.values for frame in frames], VALUES.reshape(50, -1))
    if suffix == ".npz":
        assert frames[0].values.dtype == np.uint16


def test_listed_channels_leave_the_others_at_rest(tmp_path: Path) -> None:
    file, mapping = tmp_path / "a.npz", tmp_path / "map.toml"
    np.savez(file, p=VALUES[:, 0, :3])
    mapping.write_text("rate = 50.0\n" + PLAIN + "channels = [7, 5, 6]\n")
    import_arrays(file, tmp_path / "a.mcap", mapping, robot=load_robot("nao"))
    first, second, *_ = Recording(tmp_path / "a.mcap").frames()
    assert second.stamp - first.stamp == pytest.approx(0.02)
    assert first.values[[7, 5, 6]].tolist() == VALUES[0, 0, :3].tolist()
    assert (np.delete(first.values, [5, 6, 7]) == load_robot("nao").patch("left_forearm").sensor.rest).all()


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (PLAIN, "either time or rate"),
        ('rate = 0.0\n' + PLAIN, "rate"),
        ('rate = 1.0\n' + PLAIN + "colour = 1\n", "colour"),
        ('rate = 1.0\n' + PLAIN + "channels = [1, 1]\n", "each once"),
        ('rate = 1.0\n' + PLAIN + "channels = [1, 2]\n", "240 values in a frame; valid: 2"),
        ('rate = 1.0\n' + PLAIN + "axis = 5\n", "one of its axes"),
        ('rate = 1.0\n' + PLAIN + "axis = 1\n", "50 values .*valid: the 240 channels"),
        ('time = "when"\n' + PLAIN, "no array 'when'; valid: names, p, t"),
        ('time = "names"\n' + PLAIN, "array of numbers"),
        ('time = "p"\n' + PLAIN, "'p' is named twice"),
        ('time = "t"\n' + PLAIN + "axis = 1\n", "one number for all"),
        ('rate = 1.0\n' + PLAIN.replace("left_forearm", "tail"), "tail"),
        ("rate = [", "not TOML"),
    ],
)  # fmt: skip
def test_a_mapping_that_does_not_fit_is_one_sentence(words: str, match: str, tmp_path: Path) -> None:
    file, mapping = tmp_path / "a.npz", tmp_path / "map.toml"
    np.savez(file, t=TIMES, p=VALUES.reshape(50, -1), names=np.array(["a", "b"]))
    mapping.write_text(words)
    with pytest.raises((DescriptionError, RecordingError, TciError), match=match) as error:
        import_arrays(file, tmp_path / "a.mcap", mapping, robot=load_robot("nao"))
    assert type(error.value) in (DescriptionError, RecordingError) or "tail" in str(error.value)
    assert not list(tmp_path.glob("*.mcap*"))


def test_files_that_are_damaged_or_too_large_take_no_memory(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text("rate = 1.0\n" + PLAIN)
    with (
        zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as bomb,
        bomb.open("p.npy", "w") as p,
    ):
        p.write(b"\0")
    bomb_bytes = bytearray((tmp_path / "bomb.npz").read_bytes())
    where = bomb_bytes.index(b"PK\x01\x02") + 24  # uncompressed size in the central directory of the zip file
    bomb_bytes[where : where + 4] = (LARGEST + 1).to_bytes(4, "little")
    (tmp_path / "bomb.npz").write_bytes(bomb_bytes)
    (tmp_path / "cut.npz").write_bytes(written(tmp_path, ".npz")[0].read_bytes()[:200])
    (tmp_path / "cut.mat").write_bytes(written(tmp_path, ".mat")[0].read_bytes()[:200])
    np.savez(tmp_path / "objects.npz", p=np.array([{}], dtype=object))
    (tmp_path / "long.csv").write_text("p\n" + "1" * 2**21)
    (tmp_path / "words.csv").write_text("p,q\n1,2\nx,3\n")
    (tmp_path / "short.csv").write_text("p,q\n1\n")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "loose.csv").write_text("p,q\n1_0,2\n")
    (tmp_path / "twice.csv").write_text("p,q,p\n1,2,3\n")
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as huge, huge.open("p.npy", "w") as p:
        np.lib.format.write_array_header_1_0(p, {"descr": "<f8", "fortran_order": False, "shape": (2**50,)})
    mapping.write_text("rate = 1.0\n" + PLAIN)
    for name, match in (
        ("bomb.npz", "takes 1073741825 bytes"), ("cut.npz", "no NPZ file"), ("cut.mat", "no MATLAB file"),
        ("objects.npz", "no NPZ file of numbers"), ("long.csv", "longer"), ("words.csv", "row 3"),
        ("short.csv", "row 2: 1 cells"), ("empty.csv", "no columns"), ("loose.csv", "row 2: '1_0'"),
        ("twice.csv", "two columns 'p'"), ("huge.npz", "no NPZ file"),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=match):
            import_arrays(tmp_path / name, tmp_path / "a.mcap", mapping)
    assert not list(tmp_path.glob("*.mcap*"))


def test_an_import_is_replayed_like_a_recording(tmp_path: Path) -> None:
    file, mapping = written(tmp_path, ".npz")
    out = tmp_path / "a.mcap"
    import_arrays(file, out, mapping, robot=load_robot("nao"))
    with connect("nao", f"replay:{out}") as driver:
        stamps = {frame.stamp for _ in driver.ticks() for frame in driver.read().skin}
    assert len(stamps) == len(TIMES)


@pytest.mark.parametrize(("mark", "point"), [(",", "."), (";", "."), (";", ","), ("\t", ",")])
def test_tables_of_any_country_are_read(mark: str, point: str, tmp_path: Path) -> None:
    rows = ["time,x0,x1", "0.00,1.5,-2", "", "0.01,3.5,4"]
    cells = [[cell.replace(".", point) for cell in row.split(",")] for row in rows]
    text = "\n".join(map(mark.join, cells))
    (tmp_path / "a.csv").write_text(text)
    (tmp_path / "map.toml").write_text('time = "time"\n[skin.tip]\nvalues = "x0:x1"')
    assert import_arrays(tmp_path / "a.csv", tmp_path / "a.mcap", tmp_path / "map.toml").periods == 2
    values = [frame.values.tolist() for frame in Recording(tmp_path / "a.mcap").frames()]
    assert values == [[1.5, -2.0], [3.5, 4.0]]
