"""What the links of a robot may do to people: the worst of many impacts for each link and region."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

import tci
from tci.errors import DescriptionError, Fault
from tci.lab.experiments.impacts import Impact
from tci.robot.blow import BANDWIDTH, PEOPLE, REACTION, ROTOR, Struck
from tci.robot.description import Robot

HEAD = (
    "A prediction, no certificate. Adults only: no limits for children exist. Skull, face and neck are not "
    "covered: no force is permitted there."
)
OURS = "twice the quasi-static forces of ISO/TS 15066:2016, Annex A, as two public sources print them"
COLUMNS = ("region", "stiffness_N_mm", "mass_kg", "force_N", "pressure_N_cm2")
"""Columns of a file of limits; the last one may be left out or empty. Force and pressure are quasi-static."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What people may get."""

    people: tuple[Struck, ...] = PEOPLE
    pressure: tuple[tuple[str, float], ...] = ()
    """Quasi-static pressure [Pa] by region, where it is known."""
    source: str = OURS

    @classmethod
    def read(cls, file: Path) -> Limits:
        """Reads a CSV file. Raises DescriptionError with all lines that are wrong."""
        people, pressures, faults = list[Struck](), list[tuple[str, float]](), list[Fault]()
        with file.open(newline="", encoding="utf-8-sig", errors="replace") as text:
            rows = csv.DictReader(text)
            missing = [name for name in COLUMNS[:4] if name not in (rows.fieldnames or ())]
            if missing:
                words = f"no column {', '.join(missing)}; valid: {', '.join(COLUMNS)}"
                raise DescriptionError(str(file), [Fault(1, words)])
            for row in rows:
                try:
                    stiffness, mass, force = (_above_zero(row, name) for name in COLUMNS[1:4])
                    pressure = _above_zero(row, COLUMNS[4]) if row.get(COLUMNS[4]) else None
                    if any(row["region"] == one.name for one in people):
                        raise ValueError(f"region {row['region']!r} again; valid: each region once")
                except ValueError as error:
                    faults.append(Fault(rows.line_num, str(error)))
                    continue
                people.append(
                    Struck(name=row["region"], stiffness=1e3 * stiffness, mass=mass, force=2.0 * force)
                )
                if pressure is not None:
                    pressures.append((row["region"], 1e4 * pressure))
        if faults or not people:
            raise DescriptionError(str(file), faults or [Fault(1, "no region; valid: a row for each region")])
        return cls(tuple(people), tuple(pressures), str(file))


def _above_zero(row: Mapping[str, str | None], name: str) -> float:
    try:
        number = float(row[name] or "")
    except ValueError:
        number = 0.0
    if not 0.0 < number < np.inf:
        raise ValueError(f"{name} {row[name]!r}; valid: a number above 0")
    return number


@dataclass(frozen=True, slots=True)
class Row:
    """All impacts of one link on one region."""

    part: str
    link: str
    region: str
    clamped: bool
    impacts: int
    over: float
    """Share of the impacts whose answered force is over the limit."""
    held: float
    """Largest force [N] that lasts if nothing lets go."""
    worst: Impact
    """The impact with the largest answered force, as a share of the limit."""
    pressure_limit: float | None
    """[Pa] for a moment; None if it is unknown."""

    @property
    def margin(self) -> float:
        """1 at no force, 0 at the limit, below 0 over it."""
        return 1.0 - self.worst.share

    def to_json(self, robot: Robot) -> dict[str, Any]:
        """The row, and the worst case as it is replayed: angles and speeds [degrees] by servo."""
        one, names = self.worst, [servo.name for servo in robot.servos]
        return {
            "part": self.part, "link": self.link, "region": self.region,
            "case": "clamped" if self.clamped else "free", "impacts": self.impacts, "share_over": self.over,
            "force_without_reaction_N": one.unanswered, "force_N": one.answered, "limit_N": one.limit,
            "margin": self.margin,
            "held_if_nothing_lets_go_N": self.held, "held_limit_N": 0.5 * one.limit,
            "pressure_N_cm2": 1e-4 * one.pressure,
            "pressure_limit_N_cm2": None if self.pressure_limit is None else 1e-4 * self.pressure_limit,
            "speed_m_s": one.speed, "effective_mass_kg": one.striker.mass,
            "worst": {
                "angles_deg": dict(zip(names, np.rad2deg(one.position).round(3).tolist(), strict=True)),
                "speeds_deg_s": {
                    name: round(float(np.rad2deg(value)), 3)
                    for name, value in zip(names, one.velocity, strict=True) if value
                },
                "point_m": one.point.round(5).tolist(), "direction": one.direction.round(5).tolist(),
            },
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class SafetyReport:
    """The rows of one robot, worst first."""

    robot: Robot
    limits: Limits
    seed: int
    impacts: int
    rows: tuple[Row, ...]
    assumed: tuple[str, ...]
    """Limits of servos that the description assumes: the report is as good as they are."""

    @property
    def parameters(self) -> dict[str, Any]:
        """What the figures depend on."""
        return {
            "robot": self.robot.name, "description": self.robot.digest, "tci": tci.__version__,
            "impacts": self.impacts, "seed": self.seed, "limits": self.limits.source,
            "reaction_s": REACTION, "servo_bandwidth_rad_s": BANDWIDTH, "rotor_share": ROTOR,
            "assumed_limits": list(self.assumed),
        }  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        rows = [row.to_json(self.robot) for row in self.rows]
        return {"notice": HEAD, **self.parameters, "rows": rows}

    def to_html(self) -> str:
        """The report as one page that loads nothing."""
        heads = ("link", "region", "case", "impacts", "peak without reaction [N]", "with it [N]", "limit [N]",
                 "margin", "over the limit", "held if nothing lets go [N]", "its limit [N]",
                 "pressure [N/cm2]", "its limit")  # fmt: skip
        lines = [
            "<!doctype html><meta charset='utf-8'><title>"
            + escape(f"{self.robot.name}: contacts")
            + "</title>",
            "<style>body{font:15px sans-serif;margin:2em}td,th{padding:.2em .7em;text-align:right}"
            "td:nth-child(-n+3),th:nth-child(-n+3){text-align:left}.over{color:#a00}</style>",
            f"<h1>{escape(self.robot.name)}: contacts with people</h1><p><b>{escape(HEAD)}</b></p><ul>",
            *(f"<li>{escape(name)}: {escape(_words(value))}</li>" for name, value in self.parameters.items()),
            "</ul><table><tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>",
        ]
        for row in self.rows:
            one, limit = row.worst, row.pressure_limit
            cells = (
                row.link, row.region, "clamped" if row.clamped else "free", str(row.impacts),
                f"{one.unanswered:.0f}", f"{one.answered:.0f}", f"{one.limit:.0f}", f"{row.margin:+.0%}",
                f"{row.over:.0%}", f"{row.held:.0f}", f"{0.5 * one.limit:.0f}", f"{1e-4 * one.pressure:.0f}",
                "unknown" if limit is None else f"{1e-4 * limit:.0f}",
            )  # fmt: skip
            over = " class='over'" if row.margin < 0.0 else ""
            lines.append(f"<tr{over}>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
        return "\n".join([*lines, "</table>", ""])


def _words(value: Any) -> str:
    return (", ".join(value) or "none") if isinstance(value, list) else str(value)


def report_of(robot: Robot, impacts: Iterable[Impact], limits: Limits, *, seed: int) -> SafetyReport:
    """Sorts impacts by link, region and case."""
    found: dict[tuple[str, str, bool], list[Impact]] = {}
    for one in impacts:
        found.setdefault((one.link, one.person.name, one.clamped), []).append(one)
    pressures = dict(limits.pressure)
    rows = [_row(same, pressures) for same in found.values()]
    assumed = tuple(servo.name for servo in robot.servos
                    if {"velocity", "acceleration", "torque"} & {*servo.limits.assumed})  # fmt: skip
    total = sum(row.impacts for row in rows)
    return SafetyReport(robot, limits, seed, total, tuple(sorted(rows, key=lambda row: row.margin)), assumed)


def _row(same: Sequence[Impact], pressures: dict[str, float]) -> Row:
    worst = max(same, key=lambda one: one.share)
    limit = pressures.get(worst.person.name)
    return Row(
        worst.part, worst.link, worst.person.name, worst.clamped, len(same),
        sum(one.share > 1.0 for one in same) / len(same), max(one.held for one in same), worst,
        None if limit is None else 2.0 * limit,
    )  # fmt: skip
