"""Which parts of a robot are limbs, whatever its body is."""

from __future__ import annotations

from tci.body.generic_body import GenericBody


def limbs(body: GenericBody) -> tuple[str, ...]:
    """Names of the parts that meet people by themselves: arms, and the fingers of a hand that no arm
    carries."""
    moved = [part for part in body.robot.parts if body.has_joint(part.name).any()]
    arms = {part.side for part in moved if part.kind == "arm"}
    return tuple(
        part.name
        for part in moved
        if part.kind == "arm" or (part.kind == "fingers" and part.side not in arms)
    )
