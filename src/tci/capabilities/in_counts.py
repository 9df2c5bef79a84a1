"""Runs a capability on skin whose forces nobody knows: counts stand for newtons until it is calibrated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.wrapper import CapabilityWrapper
from tci.errors import TciError
from tci.messages import Order, Perception
from tci.reasons import Reason


@dataclass(frozen=True)
class InCounts(CapabilityWrapper[Memory]):
    """Runs `inner` with the force of each contact as a number of counts, divided by `newton`. A patch that
    was calibrated (`tci skin calibrate`) keeps its newtons. So `InCounts(FingerReflex(), 400)` holds with 400
    counts where 1 N is asked.

    Raises TciError for a `newton` that is not above 0 and finite.
    """

    inner: Capability[Any]
    newton: float
    """Counts, summed over the taxels of a contact, that stand for 1 N."""

    def __post_init__(self) -> None:
        if not 0.0 < self.newton < np.inf:
            raise TciError(f"in counts: newton {self.newton}; valid: above 0, finite")

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return super().begin(self._seen(perception, body), body)

    def step(
        self, memory: Memory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        return super().step(memory, self._seen(perception, body), body)

    def pause(
        self, memory: Memory, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        return super().pause(memory, taken, self._seen(perception, body), body)

    def resume(
        self,
        memory: Memory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], Memory]:
        return super().resume(memory, taken, last, self._seen(perception, body), body)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        return super().fault(self._seen(perception, body), body)

    def _seen(self, perception: Perception, body: GenericBody) -> Perception:
        contacts = perception.contacts
        if not len(contacts):
            return perception
        ratio = np.ones(len(contacts))
        for row, one in enumerate(contacts):
            if len(one.taxels) and not body.calibrated(one.patch):
                ratio[row] = body.counts(one) / self.newton / one.force
        each = np.repeat(ratio, np.diff(contacts.begin))
        changed = contacts.changed(
            force=contacts.force * ratio,
            peak=contacts.peak * ratio,
            f_T=contacts.f_T * ratio[:, None],
            taxel_force=contacts.taxel_force * each,
        )
        return replace(perception, contacts=changed)
