"""Mesh files that MuJoCo can't read, COLLADA and STL as text, turned into ones that it can."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from tci.errors import DescriptionError, Fault
from tci.installed import needs

READABLE = (".stl", ".obj", ".msh")
"""Ends of the names of files that MuJoCo reads."""
_HEADER, _FACE = 84, 50
"""Bytes of a binary STL: its header, with the number of faces at the end, and each face."""


def is_readable(path: Path) -> bool:
    """Whether MuJoCo reads the file. A text that calls itself STL it does not."""
    if path.suffix.lower() == ".stl":
        with path.open("rb") as file:
            head = file.read(_HEADER)
        faces = int.from_bytes(head[_HEADER - 4 :], "little")
        return path.stat().st_size == _HEADER + _FACE * faces
    return path.suffix.lower() in READABLE


def binary_stl(path: Path) -> bytes:
    """The mesh of a file as a binary STL [m].

    Raises DescriptionError for a file that holds no mesh, MissingExtraError without trimesh.
    """
    # Each of a robot's parts reads its model again, and a COLLADA file takes 30 ms.
    return _converted(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=256)
def _converted(path: Path, _: int) -> bytes:
    with needs(f"reading the mesh {path.name}", "robots"):
        import trimesh

        if path.suffix.lower() == ".dae":
            import collada  # noqa: F401 # what trimesh reads it with
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        if mesh.units not in (None, "meter", "meters", "m"):
            mesh.convert_units("meters")
        data: bytes = mesh.export(file_type="stl")
    except Exception as error:  # whatever the reader of some format raises, the file must be named
        raise DescriptionError(str(path), [Fault(0, f"holds no readable mesh: {error}")]) from error
    if len(data) <= _HEADER:
        raise DescriptionError(str(path), [Fault(0, "holds no triangles")])
    return data
