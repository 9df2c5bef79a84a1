"""Makes perceptions of touches and postures without a robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.fields import ReceptiveField
from tci.messages import Contact, Contacts, Mode, Perception, Site
from tci.messages.frames import Array, read_only
from tci.robot.catalogue import load_robot
from tci.skin.contacts import single_contact

POSTURE = read_only(np.deg2rad([25.0, 25.0, 0.0, 60.0, 0.0]))
BOTH_ARMS = {"left_arm": POSTURE, "right_arm": POSTURE}


def touch(
    u: float,
    theta: float,
    forces: Sequence[float],
    *,
    part: str = "left_arm",
    segment: str = "forearm",
    offsets: Sequence[float] | None = None,
    sequence: int = 0,
) -> Contact:
    """Returns a contact with its centre at (u, theta). The taxels have the forces `forces` [N], at distances
    `offsets` in u from the centre."""
    taxel_u = u + (np.zeros(len(forces)) if offsets is None else np.array(offsets))
    origin, x = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]
    return single_contact(
        Site(f"{part}_{segment}", part, segment), range(len(forces)), forces,
        stamp=0.01 * sequence, sequence=sequence, area=1e-4, u=u, theta=theta, taxel_u=taxel_u,
        taxel_theta=np.full(len(forces), theta), p_L=origin, n_L=x, p_T=origin, n_T=x,
        f_T=[-float(np.sum(forces)), 0.0, 0.0],
    )  # fmt: skip


def poke(field: ReceptiveField, force: float, *, part: str = "left_arm", sequence: int = 0) -> Contact:
    """Returns a contact of one taxel with `force` [N] at the centre of `field`."""
    return touch(field.u, field.theta, [force], part=part, segment=field.segment, sequence=sequence)


@cache
def _body(robot: str) -> GenericBody:
    return GenericBody(load_robot(robot))


def body_that(robot: str = "nao", **answers: Callable[..., Any]) -> GenericBody:
    """Returns a robot's body in which `answers` replace some methods."""
    body = object.__new__(GenericBody)
    body.__dict__.update(vars(_body(robot)))
    for name, answer in answers.items():
        assert hasattr(body, name)
        object.__setattr__(body, name, answer)
    return body


def away(perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
    """Replaces `GenericBody.retreat`: every motion moves away from all contacts."""
    return np.ones((3, 1, len(perception.contacts))) * np.reshape([1.0, 1.0, 0.0], (3, 1, 1))


BODY = body_that(retreat=away)
"""A NAO whose `retreat` says that every motion moves away from the contacts."""


def see(*contacts: Contact, stamp: float = 0.0, posture: Mapping[str, Array] = BOTH_ARMS) -> Perception:
    """Returns the perception of contacts at `stamp` [s]."""
    return Perception(stamp=stamp, posture=posture, contacts=Contacts.of(contacts))


def one_field(**changes: Any) -> ReceptiveField:
    """Returns a field on the forearm's flexor side, with simple numbers."""
    words: dict[str, Any] = {
        "name": "field",
        "segment": "forearm",
        "u": 0.5,
        "theta": 0.0,
        "radius": 0.3,
        "threshold": 1.0,
        "saturation": 3.0,
        "motion": (0.3, -0.2, 0.0, 0.4, 0.1),
    }
    return ReceptiveField(**{**words, **changes})
