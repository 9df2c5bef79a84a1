"""The compiled response of the reflex equals equations 5-7 in plain Python and NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.touches import one_field, touch
from tci.capabilities.discounts import phi, printed, psi
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import Contact
from tci.robot.limb import generic_limb_distance


def force_of(contact: Contact, radius: float, measure: str) -> float:
    if measure != "weighted":
        return {"total": contact.force, "peak": contact.peak}[measure]
    apart = generic_limb_distance(contact.taxel_u, contact.taxel_theta, contact.u, contact.theta)
    weights = np.maximum(2.0 * radius - apart, 0.0)
    return float(weights @ contact.taxel_forces / weights.sum()) if weights.sum() > 0.0 else 0.0


@pytest.mark.parametrize("measure", ["total", "weighted", "peak"])
@pytest.mark.parametrize("response", ["meant", "printed"])
@given(seed=st.integers(0, 100_000))
def test_answer_equals_the_equations(response: str, measure: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    fields = tuple(
        one_field(
            name=f"field_{i}", u=random.random(), theta=random.uniform(-np.pi, np.pi), measure=measure,
            radius=random.uniform(0.05, 0.6), segment=str(random.choice(["upper_arm", "forearm"])),
        )
        for i in range(6)
    )  # fmt: skip
    forces = random.uniform(0.0, 6.0, 5).tolist()
    offsets = random.uniform(-0.4, 0.4, 5).tolist()
    contact = touch(random.random(), random.uniform(-np.pi, np.pi), forces, offsets=offsets)
    reflex = WithdrawalReflex(fields=fields, response=response)
    inside = [
        (float(generic_limb_distance(contact.u, contact.theta, f.u, f.theta)), f)
        for f in fields
        if f.segment == contact.segment
    ]
    inside = [(apart, f) for apart, f in inside if apart < f.radius]
    gain = 0.0
    if inside:
        apart, closest = min(inside, key=lambda pair: pair[0])
        force, limits = force_of(contact, closest.radius, measure), (closest.threshold, closest.saturation)
        gain = phi(force, *limits) * psi(apart, closest.radius)
        if response == "printed":
            gain = printed(force, *limits, apart, closest.radius)
    answer = reflex.answer(contact)
    assert (answer is None) == (gain == 0.0)
    if answer is not None:
        assert (answer.name, answer.motion) == (closest.name, closest.motion)
        assert answer.gain == pytest.approx(gain, rel=1e-9)
