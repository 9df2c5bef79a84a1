"""Sequences of touches in files: BIDS `events.tsv`, and annotations of videos by ELAN and BORIS.

All faults of a file are told at once, each with its line and what is valid there.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from tci.body.generic_body import GenericBody
from tci.errors import DescriptionError, Fault, TciError
from tci.robot.xml.document import parse, read_bytes
from tci.touches.kinds import KINDS, Kind, kind_named, read_kinds
from tci.touches.places import find_spot
from tci.touches.touch import Touch, parse_touch

COLUMNS = (
    "onset", "duration", "kind", "place", "hand", "force_N", "speed_m_s", "strength", "person", "act",
)  # fmt: skip
_OF = {"force_N": "force", "speed_m_s": "speed"}
_NUMBERS = ("onset", "duration", "force_N", "speed_m_s")
NONE = "n/a"
"""BIDS's word for a value that is not known."""
OWN_KINDS = "touches.csv"
"""A file of this name beside a sequence has more kinds of touches."""
LARGEST = 16 << 20
Rows = list[tuple[int, Callable[[], Touch]]]


def read_touches(
    path: str | Path, *, body: GenericBody | None = None, kinds: Mapping[str, Kind] | None = None
) -> tuple[Touch, ...]:
    """Reads a sequence of touches.

    A `.tsv` is a BIDS events file, a `.eaf` an ELAN annotation document, a `.csv` or `.txt` an export of
    BORIS (tabular or aggregated events) or of ELAN (with column headers; one column for each tier, or columns
    Tier and Annotation). In ELAN an annotation is a line of words as for `parse_touch`, or a kind on a tier
    with the name of the place. In BORIS the behaviour is the
    kind, the modifiers are the place and the strength, the subject is the person.

    Args:
        path: the file.
        body: a robot; the places are then looked for on its skin.
        kinds: by default those of TCI, and those in a file `touches.csv` beside the sequence.

    Raises DescriptionError with all faults of the file.
    """
    path = Path(path)
    kinds = kinds_beside(path) if kinds is None else kinds
    source = str(path)
    data = read_bytes(path, limit=LARGEST)
    if path.suffix == ".eaf":
        rows = _eaf_rows(data, source, kinds)
    else:
        rows = _table_rows(data.decode("utf-8-sig", "replace"), path.suffix, source, kinds)
    found, faults = [], list[Fault]()
    for line, make in rows:
        try:
            touch = make()
            kind_named(touch.kind, kinds)
            if body is not None:
                find_spot(body, touch.place)
            found.append(touch)
        except (TciError, ValueError) as error:
            faults.append(Fault(line, str(error)))
    if faults:
        raise DescriptionError(source, faults)
    if not found:
        raise DescriptionError(source, [Fault(0, f"no touches; valid: rows with {', '.join(COLUMNS)}")])
    return tuple(sorted(found, key=lambda touch: touch.onset if touch.onset is not None else math.inf))


def kinds_beside(path: Path) -> Mapping[str, Kind]:
    """The kinds of TCI, and those in a file `touches.csv` beside a sequence."""
    own = path.with_name(OWN_KINDS)
    return read_kinds(own) if own.is_file() and own != path else KINDS


def write_touches(path: str | Path, touches: Iterable[Touch]) -> None:
    """Writes a BIDS events file; what is None becomes `n/a`."""
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, delimiter="\t", lineterminator="\n")
        rows.writerow(COLUMNS)
        for touch in touches:
            values = (getattr(touch, _OF.get(name, name)) for name in COLUMNS)
            rows.writerow([_shown(value) for value in values])


def _shown(value: float | str | None) -> str:
    if isinstance(value, float | int):
        return f"{value:.6g}"
    return value or NONE


def _table_rows(text: str, suffix: str, source: str, kinds: Mapping[str, Kind]) -> Rows:
    lines = text.splitlines()
    head = lines[0] if lines else ""
    mark = "\t" if "\t" in head else ";" if ";" in head and "," not in head else ","
    table = csv.reader(lines, delimiter=mark)
    names = [name.strip() for name in next(table, [])]
    rows = [(table.line_num, row) for row in table if any(cell.strip() for cell in row)]
    if "onset" in names:
        return _bids_rows(names, rows, source)
    if "Behavior" in names:
        return _boris_rows(names, rows, kinds)
    if any(name.startswith("Begin Time") for name in names):
        return _elan_rows(names, rows, source, kinds)
    expected = (
        f"BIDS ({', '.join(COLUMNS)}), BORIS (Behavior, Time or Start (s)), ELAN (Begin Time - ss.msec)"
    )
    raise DescriptionError(source, [Fault(1, f"columns {', '.join(names) or 'none'}; valid: {expected}")])


def _bids_rows(names: list[str], rows: list[tuple[int, list[str]]], source: str) -> Rows:
    names = ["kind" if name == "trial_type" and "kind" not in names else name for name in names]
    missing = [name for name in ("onset", "duration", "kind", "place") if name not in names]
    if missing:
        raise DescriptionError(
            source, [Fault(1, f"no column {', '.join(missing)}; valid: {', '.join(COLUMNS)}")]
        )
    return [(line, _maker(_bids_touch, dict(zip(names, row, strict=False)))) for line, row in rows]


def _bids_touch(row: Mapping[str, str]) -> Touch:
    values: dict[str, Any] = {}
    for name in COLUMNS:
        text = row.get(name, NONE).strip()
        if text in (NONE, ""):
            continue
        values[_OF.get(name, name)] = _number(name, text) if name in _NUMBERS else text
    for name in ("kind", "place"):
        if name not in values:
            raise ValueError(f"no {name}; valid: a {name} in each row")
    if values.get("duration") == 0.0:  # BIDS: an event without a duration
        del values["duration"]
    return Touch(**values)


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{name} {text!r}; valid: a number, or {NONE}")
    return value


def _maker(make: Callable[..., Touch], *arguments: Any) -> Callable[[], Touch]:
    return lambda: make(*arguments)


def _boris_rows(names: list[str], rows: list[tuple[int, list[str]]], kinds: Mapping[str, Kind]) -> Rows:
    """Both exports of BORIS: aggregated events have begin and end in a row, tabular events one row each."""
    found: Rows = []
    open_ones: dict[tuple[str, str, str], tuple[int, float, dict[str, str]]] = {}
    for line, cells in rows:
        row = dict(zip(names, cells, strict=False))
        kind_of = row.get("Behavior type", "").upper()
        if "Start (s)" in names:
            found.append((line, _maker(_boris_touch, row, row["Start (s)"], row.get("Stop (s)", ""), kinds)))
            continue
        key = row.get("Subject", ""), row["Behavior"], _modifiers(row)
        if kind_of == "START":
            open_ones[key] = line, 0.0, row
        elif kind_of == "STOP" and key in open_ones:
            begun, _, first = open_ones.pop(key)
            found.append(
                (begun, _maker(_boris_touch, first, first.get("Time", ""), row.get("Time", ""), kinds))
            )
        elif kind_of == "STOP":
            found.append((line, _maker(_refuse, f"STOP of {row['Behavior']!r} without its START")))
        else:
            found.append((line, _maker(_boris_touch, row, row.get("Time", ""), "", kinds)))
    for line, _, row in open_ones.values():
        found.append((line, _maker(_refuse, f"START of {row['Behavior']!r} without its STOP")))
    return sorted(found, key=lambda one: one[0])


def _refuse(message: str) -> Touch:
    raise ValueError(f"{message}; valid: both, with the same subject and modifiers")


def _modifiers(row: Mapping[str, str]) -> str:
    cells = [text for name, text in row.items() if name.startswith("Modifier") and text.strip()]
    return " ".join(
        word.strip() for cell in cells for word in re.split(r"[|,]", cell) if word.strip() != "None"
    )


def _boris_touch(row: Mapping[str, str], begin: str, end: str, kinds: Mapping[str, Kind]) -> Touch:
    person = row.get("Subject", "").strip()
    words = [row["Behavior"].strip(), _modifiers(row)]
    if person and person != "No focal subject":
        words.append(f"by {person.replace(' ', '_')}")
    return _annotated(" ".join(words), "", begin, end, kinds)


def _annotated(text: str, tier: str, begin: str, end: str, kinds: Mapping[str, Kind]) -> Touch:
    first = _number("begin", begin)
    text = text.strip()
    touch = parse_touch(f"{text} {tier}" if text in kinds else text, kinds)
    length = _number("end", end) - first if end not in ("", NONE, "NA") else 0.0
    values = {name: getattr(touch, name) for name in touch.__slots__}
    return Touch(**{**values, "onset": first, "duration": length or touch.duration})


def _elan_rows(
    names: list[str], rows: list[tuple[int, list[str]]], source: str, kinds: Mapping[str, Kind]
) -> Rows:
    begin = next((name for name in names if name.startswith("Begin Time") and "ss.msec" in name), None)
    end = next((name for name in names if name.startswith("End Time") and "ss.msec" in name), None)
    if begin is None or end is None:
        message = "no times in seconds; valid: Begin Time - ss.msec and End Time - ss.msec"
        raise DescriptionError(source, [Fault(1, message)])
    words = next((name for name in names if re.fullmatch(r"(?i)annotation( value)?", name)), None)
    tiers = [name for name in names if not re.match(r"(Begin|End) Time|Duration", name) and name]
    found: Rows = []
    for line, cells in rows:
        row = {name: cell.strip() for name, cell in zip(names, cells, strict=False)}
        said = (
            [(row.get("Tier", ""), row.get(words, ""))]
            if words
            else [(one, row.get(one, "")) for one in tiers]
        )
        person = row.get("Participant", "").replace(" ", "_") if words else ""
        for tier, text in said:
            if text:
                make = _maker(_annotated, text, tier.replace("_", " "), row[begin], row[end], kinds)
                found.append((line, _maker(_by, make, person)))
    return found


def _eaf_rows(data: bytes, source: str, kinds: Mapping[str, Kind]) -> Rows:
    root = parse(data, source)
    slots = {one.get("TIME_SLOT_ID"): one.get("TIME_VALUE") for one in root.iter("TIME_SLOT")}
    found: Rows = []
    for tier in root.iter("TIER"):
        name = (tier.get("TIER_ID") or "").replace("_", " ")
        person = (tier.get("PARTICIPANT") or "").strip().replace(" ", "_")
        for one in tier.iter("ALIGNABLE_ANNOTATION"):
            text = (one.findtext("ANNOTATION_VALUE") or "").strip()
            times = [slots.get(one.get(f"TIME_SLOT_REF{end}")) for end in (1, 2)]
            line = one.sourceline or 0
            if not text:
                continue
            if None in times:
                found.append((line, _maker(_refuse, f"annotation {text!r} without times")))
                continue
            begin, end = (str(int(time or 0) / 1000.0) for time in times)
            found.append((line, _maker(_by, _maker(_annotated, text, name, begin, end, kinds), person)))
    return found


def _by(make: Callable[[], Touch], person: str) -> Touch:
    touch = make()
    values = {name: getattr(touch, name) for name in touch.__slots__}
    return Touch(**{**values, "person": touch.person or person})
