"""The kinds of touches: a table that users extend with rows of their own."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tci.errors import DescriptionError, Fault, UnknownNameError
from tci.robot.xml.document import read_bytes

Range = tuple[float, float]
STRENGTHS = ("gentle", "normal", "rough")
"""As in CoST (Jung et al. 2014)."""
GENERATORS = ("none", "pulses", "steady", "passes", "strokes", "wander", "knead")
HANDS = ("flat", "grip", "pinch")


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of touch: what it is called, and how a hand does it.

    Ranges go from the least to the greatest value that people are assumed to use. Only the speed of a stroke
    is published (1 to 10 cm/s is felt as pleasant, Loken et al. 2009); the other ranges are our own choice.
    """

    name: str
    definition: str
    source: str
    """Where the word is defined: `CoST` (Jung et al. 2014) or the `Touch dictionary` (Yohanan and MacLean
    2012), in our own words."""
    cost: str
    """Label in the data set CoST; empty if it has none."""
    haart: str
    """Label in the data set HAART."""
    vr: str
    """Label in the VR gesture data set (Crowder et al. 2026)."""
    dictionary: str
    """Label in the Touch dictionary."""
    generator: str
    """How the hand moves: `pulses`, `steady`, `passes` (one way, lifted between), `strokes` (back and forth),
    `wander`, `knead`; `none` for a kind that TCI can name, but not do."""
    hand: str
    """`flat`: pads side by side; `grip`: pads around a limb; `pinch`: two fingers."""
    fingers: Range
    """Number of pads."""
    pulses: Range
    """Number of pulses, or of passes."""
    length_s: Range
    """Length of a pulse, or of the whole touch if it has no pulses [s]."""
    gap_s: Range
    """Time between two pulses [s]."""
    radius_mm: Range
    """Radius of a pad [mm]; its pressure is a Gaussian of two thirds of this width. A palm presses with the
    balls of its fingers and its heel, not evenly, so these are smaller than a hand."""
    force_N: Range
    """Force of all pads together [N]: the peak of a pulse, else the steady force."""
    way_mm: Range
    """Length of a pass, or half of the way of a motion back and forth [mm]."""
    speed_m_s: Range
    rate_Hz: Range
    """Motions back and forth per second, or steps of a finger that wanders."""

    def force(self, strength: str) -> float:
        """The force [N] of a person of average strength: the logarithm of the range is cut into three equal
        parts, and a strength is the middle of its part."""
        low, high = self.force_N
        share = (2 * STRENGTHS.index(strength) + 1) / 6.0
        return float(low * (high / low) ** share)


def read_kinds(path: str | Path, known: Mapping[str, Kind] | None = None) -> Mapping[str, Kind]:
    """The kinds in `known` (by default those of TCI) and those in a CSV file with the same columns; a row of
    a known name replaces it. Columns that a row needs no value for may be empty or absent.

    Raises DescriptionError with all faults of the file.
    """
    path = Path(path)
    found, faults = dict(KINDS if known is None else known), list[Fault]()
    lines = read_bytes(path).decode("utf-8-sig", "replace").splitlines()
    reader = csv.DictReader(lines)
    names = [one.name for one in fields(Kind)]
    for column in reader.fieldnames or ():
        if column not in names:
            faults.append(Fault(1, f"no column named {column!r}; valid: {', '.join(names)}"))
    for row in () if faults else reader:
        try:
            kind = _kind(row)
            found[kind.name] = kind
        except ValueError as error:
            faults.append(Fault(reader.line_num, str(error)))
    if faults:
        raise DescriptionError(str(path), faults)
    return MappingProxyType(found)


def kind_named(name: str, kinds: Mapping[str, Kind] | None = None) -> Kind:
    """Raises UnknownNameError with all names for an unknown kind, and for one without a generator."""
    kinds = KINDS if kinds is None else kinds
    if name not in kinds:
        raise UnknownNameError("kind of touch", name, kinds)
    return kinds[name]


def _kind(row: Mapping[str, str | None]) -> Kind:
    values: dict[str, Any] = {}
    for one in fields(Kind):
        text = (row.get(one.name) or _USUAL.get(one.name, "")).strip()
        values[one.name] = text if one.type in (str, "str") else _range(one.name, text)
    kind = Kind(**values)
    if not kind.name.replace("_", "").isalnum():
        raise ValueError(f"name {kind.name!r}; valid: letters, digits and _")
    if kind.generator not in GENERATORS:
        raise ValueError(f"generator {kind.generator!r}; valid: {', '.join(GENERATORS)}")
    if kind.hand not in HANDS:
        raise ValueError(f"hand {kind.hand!r}; valid: {', '.join(HANDS)}")
    need = ["radius_mm", "force_N", *_NEEDS.get(kind.generator, ())]
    missing = [name for name in need if not getattr(kind, name)[0] > 0.0]
    if missing:
        raise ValueError(f"{kind.name} ({kind.generator}) needs {', '.join(missing)}; valid: LOW..HIGH")
    return kind


_USUAL = {"generator": "none", "hand": "flat"}
_NEEDS = {
    "pulses": ("length_s", "gap_s"), "steady": ("length_s",), "passes": ("way_mm", "speed_m_s", "gap_s"),
    "strokes": ("length_s", "way_mm", "rate_Hz"), "wander": ("length_s", "way_mm", "rate_Hz"),
    "knead": ("length_s", "way_mm", "rate_Hz"),
}  # fmt: skip


def _range(name: str, text: str) -> Range:
    if not text:
        return (
            (1.0, 1.0) if name in ("fingers", "pulses") else (0.25, 0.25) if name == "gap_s" else (0.0, 0.0)
        )
    low, _, high = text.partition("..")
    try:
        ends = float(low), float(high or low)
    except ValueError:
        ends = 0.0, 0.0
    if not 0.0 < ends[0] <= ends[1] < 1000.0:
        raise ValueError(f"{name} {text!r}; valid: a number above 0, or LOW..HIGH")
    return ends


KINDS: Mapping[str, Kind] = read_kinds(Path(__file__).with_name("touches.csv"), {})
"""The kinds that TCI knows."""
