"""Proposes sleeves of skin for a robot without a description: cones around the geometry of its arms."""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.exports.cone import ConeFit
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.limb import Limb
from tci.lab.authoring.link_points import THINNEST, LinkPoints, cone_around
from tci.messages.frames import Array, rpy_of
from tci.robot.description import GenericPart, Patch, Robot, Sensor, TruncatedCone, Vector
from tci.robot.generic_arm import SEGMENTS
from tci.robot.shoulder import nearest_point

COVER = {"upper_arm": (0.2, 0.8), "forearm": (0.12, 0.9)}
"""Range of u that skin covers on each segment; u is 0 at the proximal joint, 1 at the distal joint. Assumed:
the skin ends before it reaches either joint."""
SLENDER = 0.18
"""Radius of the skin on a segment, as a fraction of the segment's length. This radius is used if the model
contains no geometry for the segment, or is read without meshes. Assumed: between the values of iCub's arms
and G1's arms."""
PITCH = 0.009
"""Distance [m] between taxels. Assumed: a coarser skin than that of an iCub, on whose modules taxels are 6.5
mm apart."""


def axes_of(body: FoundLimbs, limb: Limb) -> tuple[Array, Array]:
    """Returns unit vectors (3,) from shoulder to elbow and from elbow to wrist, at the model's zero."""
    upper = (limb.middle - limb.centre) / limb.length
    if limb.turn is not None:
        axis = body.joints[limb.turn].axis
        return upper, axis * float(np.sign(axis @ (limb.wrist - limb.middle)))
    return upper, (limb.wrist - limb.middle) / np.linalg.norm(limb.wrist - limb.middle)


def ends_of(body: FoundLimbs, limb: Limb) -> dict[str, tuple[Array, Array]]:
    """Returns both ends (3,) [m] of each segment's axis."""
    elbow, wrist = limb.middle, limb.wrist
    bend = body.joints[limb.bend]
    if limb.turn is not None:
        turn = body.joints[limb.turn]
        elbow = nearest_point(turn.anchor, bend.anchor, turn.axis, bend.axis)
        wrist = elbow + turn.axis * float(turn.axis @ (limb.wrist - elbow))
    upper, fore = limb.beside
    return {"upper_arm": (limb.centre + upper, limb.middle + upper), "forearm": (elbow + fore, wrist + fore)}


def sleeves(body: FoundLimbs, limb: Limb, part: GenericPart, points: LinkPoints) -> list[Patch]:
    """Returns a cone of skin around each segment of an arm. If the model has no geometry for a segment, the
    cone's radius is estimated from the segment's length.

    Raises DescriptionError if the geometry of a segment lies beside the axis of the segment.
    """
    upper, forearm = axes_of(body, limb)
    bend = body.joints[limb.bend].axis * float(np.sign(part.servos[3].scale))
    turn = [] if limb.turn is None else [body.joints[limb.turn].link]
    links = {
        "upper_arm": [body.joints[joint].link for joint in limb.ball[1:]],
        "forearm": [body.joints[limb.bend].link, *turn],
    }
    patches = []
    for segment, axis in zip(SEGMENTS, (upper, forearm), strict=True):
        begin, end = ends_of(body, limb)[segment]
        length = float(np.linalg.norm(end - begin))
        cover = [length * u for u in COVER[segment]]
        shape = points.of(links[segment]) @ body.R_RH
        fit = None if points.shapeless else cone_around(shape, begin, axis, *cover)
        if fit is None:
            radius = slender(length)
            fit = ConeFit(begin + axis * cover[0], axis, cover[1] - cover[0], radius, radius, 0.0, 0.0)
        off = fit.origin - begin
        aside = float(np.linalg.norm(off - axis * float(axis @ off)))
        if aside > max(fit.r1, fit.r2):
            message = (
                f"the shapes of {', '.join(links[segment])} lie {1e3 * aside:.0f} mm beside the axis of "
                f"{part.name}'s {segment}, so skin around them would not cover it; valid: --no-sleeves, "
                "--without-meshes, or a model whose shapes are around its joints"
            )
            raise DescriptionError(points.source, [Fault(0, message)])
        patches.append(cone_patch(f"{part.side}_{segment}", body, part, segment, fit, points, across=bend))
    return patches


def cone_patch(
    name: str, body: FoundLimbs, part: GenericPart, segment: str, fit: ConeFit, points: LinkPoints, *,
    across: Array, pitch: float = PITCH,
) -> Patch:  # fmt: skip
    """Returns a cone of skin with a distance `pitch` [m] between taxels.

    Angles around the cone are measured from the plane that contains the cone's axis and the vector `across`
    (3,).
    """
    link = part.segment(segment).link
    R_RL, p_RL = points.link_pose(link)
    z, y = -fit.axis, -across
    y = y - z * float(y @ z)
    y /= np.linalg.norm(y)
    R_LC = R_RL.T @ body.R_RH @ np.column_stack([np.cross(y, z), y, z])
    rings = max(2, round(fit.length / pitch) + 1)
    per_ring = max(6, round(np.pi * (fit.r1 + fit.r2) / pitch))
    cone = TruncatedCone(
        origin=three(R_RL.T @ (body.R_RH @ fit.origin - p_RL)),
        rpy=rpy_of(R_LC),
        length=fit.length, r1=fit.r1, r2=fit.r2, rings=rings, per_ring=per_ring,
    )  # fmt: skip
    return Patch(
        name=name, part=part.name, segment=segment, link=link, rate=100.0, channels=rings * per_ring,
        surface=cone, assumed=True,
        sensor=Sensor(rest=240.0, pascal_per_count=-600.0, lowest=0.0, highest=255.0),
    )  # fmt: skip


def slender(length: float) -> float:
    """Returns the radius [m] of skin on a segment without geometry, from its `length` [m]."""
    return max(THINNEST, SLENDER * length)


def assumed_skins(robot: Robot) -> list[str]:
    """Returns a note on patches whose radius was estimated from the length of their segment, because the
    model has no geometry for this segment. The list is empty if there are no such patches.
    """
    found = []
    for patch in robot.patches:
        cone = patch.surface
        if isinstance(cone, TruncatedCone) and patch.segment is not None:
            radius = slender(robot.part(patch.part).segment(patch.segment).length)
            if np.allclose([cone.r1, cone.r2], radius, atol=1e-5):
                found.append(f"{patch.name} ({1e3 * radius:.0f} mm)")
    if not found:
        return []
    return [
        f"skin as thick as the length of the link suggests, as no shapes of the model tell it: "
        f"{', '.join(found)}; review its radius"
    ]


def three(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
