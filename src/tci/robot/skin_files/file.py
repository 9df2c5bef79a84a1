"""Skin calibration files of iCub and NAO: the position of each taxel of a skin.

A file has the keywords `name`, `spatial_sampling` and `taxel2Repr`, and then one row `x y z nx ny nz` [m] for
each channel of the skin's port, in the order of the port. Tabs, spaces, blank lines and comments (`%`) may
occur anywhere. The files of icub-main, robots-configuration and pyCub differ; docs/skin-files.md explains the
differences.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from tci.robot.skin_files.layout import SkinLayout, make_layout
from tci.robot.skin_files.text import PER_MODULE, check_count, parse_lines, read_lines
from tci.robot.xml.document import Faults

MODULE_PITCH = 6.534e-3
"""Distance [m] between neighbouring taxels on a triangular module, computed from pyCub's taxel positions of
iCub's skin."""
PADS_OF_MODULE = (6, 10)
"""Indices of the thermal pads within a module. Thermal pads are not taxels."""
PLACEHOLDER = (1.0, 0.0, 0.0)
"""Normal that CAD exports write if no normal was measured."""


def read_skin_file(path: str | Path) -> SkinLayout:
    """Reads a skin calibration file.

    Raises DescriptionError with all faults, each with its line. These are the faults:

    - values that are not numbers, not finite or not in metres
    - rows that have neither six nor three numbers
    - missing rows
    - unknown keywords
    - a file that is not text, or that is too large
    """
    source = str(path)
    faults = Faults(source)
    lines = read_lines(Path(path))
    text = parse_lines(lines, faults)
    faults.check()
    check_count(text, len(lines), faults)
    faults.check()
    rows = np.array(text.rows)
    n = len(rows)
    valid: NDArray[np.bool_] = np.any(rows[:, :3] != 0.0, axis=-1)
    # The list may be shorter or longer than the number of rows. A missing entry means nothing.
    listed = np.array((text.representative or [])[:n], dtype=np.intp)
    representative = np.full(n, -1, dtype=np.intp)
    representative[: len(listed)] = listed
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    placeholder = valid & (rows[:, 3:] == PLACEHOLDER).all(axis=1)
    # One module that truly faces +x is no placeholder; a whole skin that does is.
    some = 2 * placeholder.sum() > valid.sum()
    return make_layout(
        source,
        rows[:, :3],
        rows[:, 3:],
        valid,
        name=text.name,
        estimated=(lengths < 1e-3) | (placeholder & some),
        # Some files round positions to a millimetre or repeat them; the module's nominal lattice is exact.
        areas=np.full(n, np.sqrt(0.75) * MODULE_PITCH**2),
        pads=_pads(valid, listed),
        modules=np.arange(n) // PER_MODULE,
        representative=representative,
        sampling=cast(Literal["taxel", "triangle"], text.sampling),
    )


def _pads(valid: NDArray[np.bool_], listed: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Returns an array (n,) that is True for channels that are thermal pads. `valid` (n,) is True for
    channels with a position; `listed` is the file's list `taxel2Repr`.

    Newer files mark pads by -2 in this list. In older files, -1 marks a pad if the channel has a position. In
    files without marks, and after the end of the list, each module (12 channels, from 0) has pads at 6 and
    10, if any of its channels has a position.
    """
    pads = np.zeros(len(valid), dtype=bool)
    pads[: len(listed)] = (listed == -2) | ((listed == -1) & valid[: len(listed)])
    on_pad = np.isin(np.arange(len(valid)) % PER_MODULE, PADS_OF_MODULE)
    module = np.arange(len(valid)) // PER_MODULE
    on_pad &= np.isin(module, module[valid])
    silent = np.arange(len(valid)) >= (len(listed) if pads.any() else 0)
    return pads | (on_pad & silent)
