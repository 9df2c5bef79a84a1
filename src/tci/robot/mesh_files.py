"""Mesh files of a model: search for the files, and conversion to binary STL if MuJoCo can't read a file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from tci.errors import DescriptionError, Fault
from tci.support.installed import needs

READABLE = (".stl", ".obj", ".msh")
"""File-name suffixes that MuJoCo reads."""
NO_MESHES = "none"
"""Value of `Model.meshes` that means: read the model without its meshes."""
VALID_MESHES = (
    "valid: new-robot --meshes DIR with a folder that has them, or --without-meshes; in a description, "
    f'meshes="FOLDER" or meshes="{NO_MESHES}" of <model>'
)
"""End of each message about meshes that are missing or broken."""
_PACKAGE = "package://"
_HEADER, _FACE = 84, 50
"""Sizes [bytes] in a binary STL file: the size of the header, which ends with the number of faces, and the
size of each face."""
MOST_FACES = 200_000
"""Largest number of faces in an STL file that MuJoCo reads."""


class MeshFiles:
    """Finds the mesh files of a model, and records those that are missing or broken."""

    def __init__(self, model: Path, folder: str | None) -> None:
        """Prepares the search. `folder` is searched for files that are not at the path given in the file
        `model`."""
        self._model = model
        self._above = model.resolve().parents
        self._own = {} if folder in (None, NO_MESHES) else _by_name(Path(str(folder)))
        self._missing: dict[str, dict[str, str]] = {}
        self._faults: dict[str, Fault] = {}

    def find(self, name: str) -> Path | None:
        """Returns the path of a mesh; None if the mesh is missing. The package in a `package://` name is
        searched in all folders above the model file."""
        relative = Path(name.removeprefix(_PACKAGE).lstrip("/"))  # some write package:///
        if name.startswith(_PACKAGE):
            places = [folder / relative for folder in self._above]
        else:
            places = [(self._model.parent / name.removeprefix("file://")).resolve()]
        for file in places:
            if file.is_file():
                return file
        if found := _most_alike(relative, self._own.get(relative.name.lower(), [])):
            return found
        if name.startswith(_PACKAGE):
            why = f"no folder {relative.parts[0]!r} with this file above {self._model.parent}"
            where = relative.parts[0]
        else:
            why, where = f"{places[0]} is not a file", str(places[0].parent)
        self._missing.setdefault(where, {})[name] = why + _other_case(places)
        return None

    def readable(self, file: Path, assets: dict[str, bytes]) -> str:
        """Returns the name by which MuJoCo finds the mesh of a file. If MuJoCo can't read the file, the mesh
        is added to `assets` as a binary STL [m]."""
        if is_readable(file):
            return str(file)
        name = Path(str(file).lstrip("/").replace("/", "_")).with_suffix(".stl").name
        try:
            assets[name] = binary_stl(file)
        except DescriptionError as error:
            self._faults[str(file)] = Fault(0, f"mesh {file}: {error.faults[0].message}")
        return name

    def check(self) -> None:
        """Raises DescriptionError with a line for each folder that lacks meshes, and for each mesh that is
        broken, if there are any."""
        faults = [*(_without(folder, meshes) for folder, meshes in self._missing.items())]
        faults += self._faults.values()
        if faults:
            *others, last = faults
            message = f"{last.message}; {VALID_MESHES}"
            raise DescriptionError(str(self._model), [*others, Fault(last.line, message)])


def _without(folder: str, missing: Mapping[str, str]) -> Fault:
    name, why = next(iter(missing.items()))
    also = f" ({len(missing) - 1} others of {folder} are missing too)" if len(missing) > 1 else ""
    return Fault(0, f"mesh {name}: {why}{also}")


def _by_name(folder: Path) -> dict[str, list[Path]]:
    """Returns all files below a folder, by their file names in lower case."""
    found: dict[str, list[Path]] = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            found.setdefault(file.name.lower(), []).append(file)
    return found


def _most_alike(wanted: Path, files: list[Path]) -> Path | None:
    """Returns the one of `files` whose path agrees with the end of the path `wanted` in the largest number of
    folder names; None if `files` is empty. Upper and lower case do not matter."""

    def alike(file: Path) -> int:
        pairs = zip(file.parts[::-1], wanted.parts[::-1], strict=False)
        return next((count for count, (one, other) in enumerate(pairs) if one.lower() != other.lower()), 99)

    return max(files, key=alike, default=None)


def _other_case(places: list[Path]) -> str:
    """Returns a hint for the message about a missing file: the name of a file that differs from it only in
    upper and lower case. Returns an empty text if there is no such file."""
    for place in places:
        if place.parent.is_dir():
            for file in place.parent.iterdir():
                if file.name.lower() == place.name.lower():
                    return f"; did you mean {file.name!r}? Upper and lower case count"
    return ""


def is_readable(path: Path) -> bool:
    """Returns True if MuJoCo can read the mesh file. MuJoCo can't read STL files that are in text form, are
    empty, or have more than 200 000 faces."""
    if path.suffix.lower() == ".stl":
        return 0 < _faces(path) <= MOST_FACES
    return path.suffix.lower() in READABLE


def _faces(path: Path) -> int:
    """Returns the number of faces in a binary STL file; 0 if the file is not a binary STL file."""
    with path.open("rb") as file:
        head = file.read(_HEADER)
    faces = int.from_bytes(head[_HEADER - 4 :], "little")
    return faces if path.stat().st_size == _HEADER + _FACE * faces else 0


def _check_faces(path: Path, faces: int) -> None:
    """Raises DescriptionError if the mesh of the file `path` has more `faces` than MuJoCo reads."""
    if faces > MOST_FACES:
        message = f"has {faces} faces; MuJoCo reads at most {MOST_FACES}"
        raise DescriptionError(str(path), [Fault(0, message)])


def binary_stl(path: Path) -> bytes:
    """Returns the mesh of a file as a binary STL [m].

    Raises DescriptionError if the file contains no mesh or too many faces, and MissingExtraError if the
    package trimesh is not installed.
    """
    # Cached: the model is read once for each of the robot's parts, and converting a COLLADA file takes 30 ms.
    return _converted(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=256)
def _converted(path: Path, _: int) -> bytes:
    if path.suffix.lower() == ".stl":
        _check_faces(path, _faces(path))  # needs no other package
    with needs(f"reading the mesh {path.name}", "robots"):
        import trimesh

        if path.suffix.lower() == ".dae":
            import collada  # noqa: F401 # trimesh needs it to read the format
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        if mesh.units not in (None, "meter", "meters", "m"):
            mesh.convert_units("meters")
        data: bytes = mesh.export(file_type="stl")
    except Exception as error:  # whatever the reader of a format raises, the message must name the file
        raise DescriptionError(str(path), [Fault(0, f"holds no readable mesh: {error}")]) from error
    if len(data) <= _HEADER:
        raise DescriptionError(str(path), [Fault(0, "holds no triangles")])
    _check_faces(path, (len(data) - _HEADER) // _FACE)
    return data
