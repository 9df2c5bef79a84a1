"""Patches of a description from the pads that its model has: part, segment, sensor, surface."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tci.lab.authoring.find_pads import Pad
from tci.lab.authoring.pad_words import finger
from tci.robot.description import GenericPart, Grid, Patch, Robot, Sensor, Table, TriangularModules
from tci.robot.generic_fingers import PALM
from tci.support.engine import mujoco

RATE = 50.0
"""Frames per second [Hz] of pads. Assumed: hands that were measured send 15 to 90."""
UNKNOWN = (0.0, 4095.0)
"""Range [counts] of a sensor of which nobody tells it. Assumed: 12 bits."""
FULL = 2e5
"""Pressure [Pa] at the end of this range. Assumed: 10 N on a square of 7 mm."""
PER_MODULE = 12
"""Channels of a triangular module: ten taxels and two thermal pads."""


def pad_patches(
    draft: Robot, parts: Sequence[GenericPart], pads: Iterable[Pad], model: mujoco.MjModel
) -> list[Patch]:
    """The patches of pads that have taxels. A pad belongs to the part whose joint moves it; pads on fingers
    and palms to the fingers, pads that nothing moves to the torso.
    A pad that is no grid has a table of taxels, which the caller writes beside the description (`table_of`).

    Args:
        draft: The robot with its servos.
        parts: Its generic parts.
        model: The model in which the pads were found.
    """
    owners = _owners(draft, parts)
    patches: list[Patch] = []
    for pad in (pad for pad in pads if pad.taxels):
        part, segment = _place(pad, parts, owners, model)
        channels = PER_MODULE * len(pad.modules) if pad.modules else pad.taxels
        patches.append(
            Patch(
                name=pad.name, part=part, segment=segment, link=pad.link, rate=RATE, channels=channels,
                sensor=sensor_of(pad), surface=_surface(pad),
            )
        )  # fmt: skip
    return patches


def sensor_of(pad: Pad) -> Sensor:
    """The response of a pad: of its device if somebody measured it, otherwise assumed."""
    owner = pad.device
    lowest, highest = UNKNOWN if owner is None else owner.values
    rest = lowest if owner is None else float(owner.rest)
    slope = FULL / (highest - rest)
    if owner is not None and owner.newton_per_count is not None and pad.grid is not None:
        slope = owner.newton_per_count * pad.taxels / (pad.grid.length * pad.grid.width)
    return Sensor(rest=rest, pascal_per_count=round(slope, 3), lowest=lowest, highest=highest)


def table_of(pad: Pad) -> str:
    """The taxels of a pad as a CSV table, in the frame of its link."""
    rows = [
        f"{index}, " + ", ".join(f"{value:.6f}" for value in (*(1e3 * place), *normal))
        for index, (place, normal) in enumerate(zip(pad.positions, pad.normals, strict=True))
    ]
    return "\n".join(["channel, x [mm], y [mm], z [mm], nx, ny, nz", *rows, ""])


def _surface(pad: Pad) -> Grid | Table | TriangularModules:
    if pad.modules:
        return TriangularModules(frames=pad.modules, ports=tuple(range(len(pad.modules))))
    if pad.grid is None:
        return Table(file=f"{pad.name}.csv", format="csv")
    return pad.grid if pad.solid else pad.grid.model_copy(update={"thickness": round(pad.thickness, 6)})


def _owners(draft: Robot, parts: Sequence[GenericPart]) -> dict[str, tuple[GenericPart, int]]:
    """For each joint of the model, by its name, the part whose generic joint moves it, and the id of this."""
    found: dict[str, tuple[GenericPart, int]] = {}
    for part in parts:
        for generic in part.servos:
            for servo in generic.moved:
                own = draft.servos[servo]
                for joint in (own.joint, *(mimic.joint for mimic in own.mimics)):
                    if joint is not None:
                        found.setdefault(joint, (part, generic.id))
    return found


def _place(
    pad: Pad, parts: Sequence[GenericPart], owners: dict[str, tuple[GenericPart, int]], model: mujoco.MjModel
) -> tuple[str, str]:
    """Part and segment of a pad; the segment is empty if the part has none there."""
    body = int(model.body(pad.link).id)
    while body and (owner := _owner(body, owners, model)) is None:
        body = int(model.body_parentid[body])
    if not body or owner is None:
        return "torso", ""
    part, id = owner
    if part.kind in ("arm", "hand") and finger(pad.name) == PALM:
        fingers = next((one for one in parts if one.kind == "fingers" and one.side == part.side), None)
        part = fingers or part
    if part.kind == "arm":
        return part.name, "forearm" if id >= 3 else "upper_arm"
    if part.kind == "fingers":
        own = PALM if finger(pad.name) == PALM else part.servos[id].name.partition("_")[0]
        return part.name, own if own in {segment.name for segment in part.segments} else ""
    return part.name, ""


def _owner(
    body: int, owners: dict[str, tuple[GenericPart, int]], model: mujoco.MjModel
) -> tuple[GenericPart, int] | None:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    joints = [str(model.joint(joint).name) for joint in range(first, first + count)]
    return next((owners[joint] for joint in joints if joint in owners), None)
