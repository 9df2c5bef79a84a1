"""Conversion of mesh files that MuJoCo can't read (COLLADA, STL as text) to binary STL."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from tci.errors import DescriptionError, Fault
from tci.installed import needs

READABLE = (".stl", ".obj", ".msh")
"""File-name suffixes that MuJoCo reads."""
_HEADER, _FACE = 84, 50
"""Sizes [bytes] in a binary STL: of the header with the number of faces at its end, and of each face."""


def is_readable(path: Path) -> bool:
    """Returns True if MuJoCo reads the file. STL files in text form are not readable."""
    if path.suffix.lower() == ".stl":
        with path.open("rb") as file:
            head = file.read(_HEADER)
        faces = int.from_bytes(head[_HEADER - 4 :], "little")
        return path.stat().st_size == _HEADER + _FACE * faces
    return path.suffix.lower() in READABLE


def binary_stl(path: Path) -> bytes:
    """Returns the mesh of a file as a binary STL [m].

    Raises DescriptionError for a file that holds no mesh, MissingExtraError without trimesh.
    """
    # Cached: the model is read once for each of the robot's parts, and converting a COLLADA file takes 30 ms.
    return _converted(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=256)
def _converted(path: Path, _: int) -> bytes:
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
    return data
