"""Computes the results of a trial from two traces: one with the reflex, one without."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.answers import Answer, withdrawal, withdrawn
from tci.lab.experiments.checker import command_violations, physics_violations, stray_servos
from tci.lab.experiments.poke import Trace
from tci.robot.description import Robot

MOTION = float(np.deg2rad(0.05))
"""Least difference [rad] that counts as motion: the difference of a joint angle between the trials with and
without the reflex. Assumed: differences are smaller if servos only yield to the finger, and larger after one
control period of a reflex."""
WITHDRAWAL = withdrawal(WithdrawalReflex())


@dataclass(frozen=True, slots=True)
class Trial:
    """One row of the report. All times are relative to the first contact."""

    robot: str
    part: str
    """Generic part that the finger poked."""
    side: str
    site: str
    """Patch and taxel, as `World.finger.poke` takes them, or the receptive field whose centre was poked."""
    taxels: int
    """Number of taxels of the patch that the finger poked."""
    depth_mm: float
    """How deep [mm] the finger's base went below where the skin was."""
    responded: bool
    """True if the reflex commanded this part and no other part, and the part's skin moved away from the
    finger; or did what else it answers such a touch with (`answers`)."""
    trigger_ms: float | None
    """Time [ms] of the first command of the reflex. The value is None if the reflex sent no command."""
    first_motion_ms: float | None
    """Time [ms] from the first contact until a joint angle first differed by at least 0.05 degrees from its
    value in the trial without reflex. The value is None if all differences were smaller."""
    contact_lost_ms: float | None
    """Time [ms] from the first contact to the end of the last contact. The value is None if the finger
    touched the skin until the end of the trial."""
    contact_lost_without_reflex_ms: float | None
    """Time [ms] from the first contact to the end of the last contact in the trial without reflex. The value
    is None if the finger touched the skin until the end of that trial, as it normally does."""
    peak_force_n: float
    """Largest contact force [N] in the physics simulation."""
    cop_error_mm: float | None
    """Distance [mm] along the skin between TCI's centre of pressure and the contact point of the physics
    simulation, at the time of the largest force. None if TCI found no contact."""
    withdrawn_mm: float
    """Displacement [mm] of the poked point of the skin along its inward normal, at the end of the trial."""
    withdrawn_without_reflex_mm: float
    limit_violations: int
    violations: tuple[str, ...]
    """Violations that the module `checker` found, one sentence each."""
    halts: tuple[str, ...]
    """Reasons for which the gate held or stopped the robot during the trial."""
    capability: str = "withdrawal"
    """What was to answer, as `tci run` takes it."""
    notes: tuple[str, ...] = ()
    """What the reflex said at the end, such as why a hand stays where it is."""


def measure(
    robot: Robot, part: str, site: str, acted: Trace, held: Trace, answer: Answer = WITHDRAWAL
) -> Trial:
    """Returns the results of one trial, in which the finger poked `part` at `site`.

    `acted` is the trace with the reflex, `held` the trace without the reflex.
    """
    period = 1.0 / robot.binding("sim").rate
    contact = acted.first_contact
    began = [
        stamp
        for stamp, _ in acted.commanded
        if not answer.moves_before or (contact is not None and stamp >= contact)
    ]
    violations: dict[str, None] = {}
    halts: dict[str, None] = {}
    without = np.array(held.positions), np.array(held.velocities)
    untouched = sum(stamp < (held.first_contact or np.inf) for stamp in held.time)
    for trace in (acted, held):
        moved = np.array(trace.positions), np.array(trace.velocities)
        commanded = {servo for sent in trace.sent for servo in sent.servos.tolist() if not answer.weak}
        violations |= dict.fromkeys(
            command_violations(robot, trace.sent, trace.positions, period, led=answer.led)
            + stray_servos(robot, answer.moves(robot, part), trace.sent)
            + physics_violations(robot, *moved, without=without, commanded=commanded)
        )
        halts |= dict.fromkeys(f"{sent.state.value}: {sent.reason}" for sent in trace.sent if sent.reason)
    if untouched:
        violations |= dict.fromkeys(physics_violations(robot, *(one[:untouched] for one in without)))
    return Trial(
        robot=robot.name,
        part=part,
        side=robot.part(part).side or "",
        site=site,
        taxels=acted.taxels,
        depth_mm=round(acted.depth * 1e3, 3),
        responded=answer.shown(robot, part, acted, held),
        capability=answer.name,
        trigger_ms=_milliseconds(began[0] if began else None, contact),
        first_motion_ms=_milliseconds(_first_motion(acted, held), contact),
        contact_lost_ms=_milliseconds(acted.contact_lost, contact),
        contact_lost_without_reflex_ms=_milliseconds(held.contact_lost, contact),
        peak_force_n=acted.peak_force,
        cop_error_mm=cop_error(acted),
        withdrawn_mm=withdrawn(acted),
        withdrawn_without_reflex_mm=withdrawn(held),
        limit_violations=len(violations),
        violations=tuple(violations),
        halts=tuple(halts),
        notes=acted.notes,
    )


def _milliseconds(stamp: float | None, start: float | None) -> float | None:
    return None if stamp is None or start is None else round((stamp - start) * 1e3, 3)


def _first_motion(acted: Trace, held: Trace) -> float | None:
    times = np.array(acted.time) - acted.start
    same = np.searchsorted(np.array(held.time) - held.start, times - 1e-9).clip(max=len(held.time) - 1)
    difference = np.abs(np.array(acted.positions) - np.array(held.positions)[same]).max(axis=1)
    moved = difference >= MOTION
    return acted.time[int(moved.argmax())] if moved.any() else None


def cop_error(trace: Trace) -> float | None:
    """Returns the distance [mm] along the skin between TCI's centre of pressure and the contact point of the
    physics simulation.

    Only frames are used in which both TCI and the physics simulation have a contact; of these, the frame with
    the largest force that TCI measured. Returns None if there is no frame with both contacts.
    """
    stamps = [stamp for stamp in trace.contacts if stamp in trace.center]
    if not stamps:
        return None
    stamp = max(stamps, key=lambda stamp: trace.contacts[stamp].force)
    contact = trace.contacts[stamp]
    error = contact.p_T - trace.center[stamp]
    return float(np.linalg.norm(error - (error @ contact.n_T) * contact.n_T) * 1e3)
