"""Trials of touch without skin: pushes on a moving arm, and motion without a push."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from helpers.bare_body import answered_places, bare_body, random_push
from helpers.pushed_arm import PERIOD, Plant, Push
from tci.body.perceiver import Perceiver
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.gate.gate import Gate
from tci.messages import Contact, Reading

NEWTON = 15.0
BEGIN, LOOKED_AT, END = 0.3, 0.5, 0.6
"""Times [s] at which the push begins, at which the estimate is judged, and at which the push ends."""
ANSWERED, MOVED, AWAY = 0.5, 0.4, 0.002
"""Longest time [s] from a push to the response, time [s] after the response within which the arm must have
moved, and least displacement [m] along the push."""


@dataclass(frozen=True)
class Felt:
    """A push, and the contact that was estimated 0.2 s after the push began."""

    patch: str
    """Patch that was pushed."""
    push: Push
    contact: Contact | None
    """Contact that was estimated; None if there was none."""

    @property
    def right(self) -> bool:
        """True if the contact was estimated on the segment that was pushed."""
        return self.contact is not None and self.contact.patch == self.patch

    @property
    def error(self) -> float:
        """Distance [m] between the estimated and the true place; infinite if the segment is wrong or there is
        no contact."""
        if self.contact is None or not self.right:
            return float("inf")
        return float(np.linalg.norm(self.contact.p_L - self.push.point))

    @property
    def force_error(self) -> float:
        """Relative error of the force; 1 if there is no contact."""
        return 1.0 if self.contact is None else abs(self.contact.force / NEWTON - 1.0)

    @property
    def certainty(self) -> float:
        """Certainty of the contact; 0 if there is no contact."""
        return 0.0 if self.contact is None else self.contact.certainty


def pushed(patch: str, seed: int) -> Felt:
    """Pushes a random place of a moving arm with the force `NEWTON`."""
    body = bare_body()
    plant, perceiver = Plant(body.robot, seed), Perceiver(body)
    push = random_push(patch, np.random.default_rng([seed, 1]), newton=NEWTON, begin=BEGIN, end=END)
    while True:
        joints = plant.step(push)
        found = perceiver.step(Reading(joints, ()), joints.stamp).contacts
        if plant.time >= LOOKED_AT:
            return Felt(patch, push, found[0] if found else None)


def untouched(seed: int, seconds: float) -> tuple[int, float]:
    """Moves an arm without any touch.

    Returns the number of contacts, and the processor time [s] within which 99 % of the perceptions were made.
    """
    body = bare_body()
    random = np.random.default_rng([seed, 2])
    plant = Plant(body.robot, seed, amplitude=random.uniform(0.3, 0.6), hertz=random.uniform(0.2, 0.6))
    perceiver, seen, took = Perceiver(body), set[int](), []
    for _ in range(round(seconds / PERIOD)):
        joints = plant.step()
        begin = time.thread_time()
        perception = perceiver.step(Reading(joints, ()), joints.stamp)
        took.append(time.thread_time() - begin)
        seen |= set(perception.contacts.identity.tolist())
    return len(seen), float(np.percentile(took, 99.0))


def withdrawn(patch: str, seed: int) -> tuple[bool, bool]:
    """Pushes a moving arm in a receptive field of the withdrawal reflex, whose commands pass through the
    gate.

    Returns two truth values: if the reflex responded within `ANSWERED`, and if the pushed place then moved by
    at least `AWAY` farther along the push than on an arm that only stops, which the push also displaces.
    """
    random = np.random.default_rng([seed, 3])
    end, places = BEGIN + ANSWERED + MOVED, answered_places(patch)
    push = random_push(patch, random, newton=NEWTON, begin=BEGIN, end=end, places=places)
    moved = _displaced(seed, push, withdraws=True)
    return moved is not None, moved is not None and moved - (_displaced(seed, push) or 0.0) > AWAY


def _displaced(seed: int, push: Push, *, withdraws: bool = False) -> float | None:
    """Returns the displacement [m] along the push within `MOVED` after the reflex responded.

    Without `withdraws`, the arm stops at this time. Returns None if the reflex did not respond.
    """
    body, reflex = bare_body(), WithdrawalReflex()
    plant, perceiver = Plant(body.robot, seed), Perceiver(body)
    gate, memory = Gate(body.robot, period=PERIOD, stale_after=0.05), reflex.init(body)
    until, target = BEGIN + ANSWERED, None
    while plant.time < until:
        joints = plant.step(push, target=target)
        perception = perceiver.step(Reading(joints, ()), joints.stamp)
        pose = body.skin.link_pose(push.link, joints)
        here = pose[:3, :3] @ push.point + pose[:3, 3]
        commands, memory = reflex.step(memory, perception, body)
        if commands and target is None:
            start, along = here, pose[:3, :3] @ push.force / NEWTON
            until, target = plant.time + MOVED, plant.target
        if target is not None and withdraws:
            orders, _ = body.to_platform(commands, joints)
            safe = gate.step(orders, joints, joints.stamp)
            wanted = plant.home.copy()
            wanted[plant.servos] = target
            wanted[safe.servos] = safe.position
            target = wanted[plant.servos]
    return None if target is None else float(along @ (here - start))
