"""The figures of a trial, from its trace with the reflex and its trace without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.experiments.checker import command_violations, physics_violations, stray_servos
from tci.experiments.poke import Trace
from tci.robot.description import Robot

MOTION = float(np.deg2rad(0.05))
"""Smallest difference [rad] of a joint to the same trial without reflex that counts as motion."""

AWAY = 1.0
"""Least way [mm] of the skin along its inward normal, beyond that without reflex, that leads away from the
finger. Assumed: more than servos yield."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One row of the report. Times count from first contact."""

    robot: str
    side: str
    site: str
    taxels: int
    """Taxels of the poked patch."""
    responded: bool
    """The reflex commanded this part, and no other, and its skin moved away from the finger."""
    trigger_ms: float | None
    """Until the reflex's first command."""
    first_motion_ms: float | None
    """Until a joint moved 0.05 degrees in the physics, against the same trial without reflex."""
    contact_lost_ms: float | None
    """Until the finger no longer touched, for the rest of the trial."""
    contact_lost_without_reflex_ms: float | None
    """The same without the reflex: None, for the finger stays."""
    peak_force_n: float
    """Largest contact force of the physics."""
    cop_error_mm: float | None
    """Distance along the skin between TCI's centre of pressure and the physics' contact point, in
    the frame with the largest force."""
    withdrawn_mm: float
    """How far the skin at the field's centre moved along the inward normal by the end."""
    withdrawn_without_reflex_mm: float
    limit_violations: int
    violations: tuple[str, ...]
    """What the separate checker found, in words."""
    halts: tuple[str, ...]
    """Why the gate held or stopped the robot in the meantime."""


def measure(robot: Robot, part: str, site: str, acted: Trace, held: Trace) -> Trial:
    """The figures of one trial: `acted` with the reflex, `held` without it."""
    period = 1.0 / robot.binding("sim").rate
    contact = acted.first_contact
    commanded = [stamp for stamp, _ in acted.commanded]
    violations: list[str] = []
    halts: dict[str, None] = {}
    right = bool(commanded) and {name for _, name in acted.commanded} == {part}
    for trace in (acted, held):
        violations += command_violations(robot, trace.sent, trace.positions, period)
        violations += stray_servos(robot, part, trace.sent)
        violations += physics_violations(robot, np.array(trace.positions), np.array(trace.velocities))
        halts |= dict.fromkeys(f"{sent.state.value}: {sent.reason}" for sent in trace.sent if sent.reason)
    return Trial(
        robot=robot.name,
        side=robot.part(part).side or "",
        site=site,
        taxels=acted.taxels,
        responded=right and _withdrawn(acted) - _withdrawn(held) >= AWAY,
        trigger_ms=_milliseconds(commanded[0] if commanded else None, contact),
        first_motion_ms=_milliseconds(_first_motion(acted, held), contact),
        contact_lost_ms=_milliseconds(acted.contact_lost, contact),
        contact_lost_without_reflex_ms=_milliseconds(held.contact_lost, contact),
        peak_force_n=acted.peak_force,
        cop_error_mm=cop_error(acted),
        withdrawn_mm=_withdrawn(acted),
        withdrawn_without_reflex_mm=_withdrawn(held),
        limit_violations=len(violations),
        violations=tuple(violations),
        halts=tuple(halts),
    )


def _milliseconds(stamp: float | None, start: float | None) -> float | None:
    return None if stamp is None or start is None else round((stamp - start) * 1e3, 3)


def _first_motion(acted: Trace, held: Trace) -> float | None:
    times = np.array(acted.time) - acted.start
    same = np.searchsorted(np.array(held.time) - held.start, times - 1e-9).clip(max=len(held.time) - 1)
    difference = np.abs(np.array(acted.positions) - np.array(held.positions)[same]).max(axis=1)
    moved = difference >= MOTION
    return acted.time[int(moved.argmax())] if moved.any() else None


def _withdrawn(trace: Trace) -> float:
    return (trace.away[-1] - trace.away[0]) * 1e3


def cop_error(trace: Trace) -> float | None:
    """Tangential distance [mm] between the centre of pressure and the physics' contact point."""
    stamps = [stamp for stamp in trace.contacts if stamp in trace.center]
    if not stamps:
        return None
    stamp = max(stamps, key=lambda stamp: trace.contacts[stamp].force)
    contact = trace.contacts[stamp]
    error = contact.p_T - trace.center[stamp]
    return float(np.linalg.norm(error - (error @ contact.n_T) * contact.n_T) * 1e3)
