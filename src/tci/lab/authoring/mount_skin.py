"""Finds the pose of a skin on its link from self-touch: one skin of a robot touches another skin of that
robot (Roncone et al. 2014).

The poses of both links are known from kinematics. In each touch, both skins meet at one point. If the skins
report different places for this point, the difference is the rigid error of the mount. Only the pressed
taxels are used, not their forces.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

from tci.body.generic_body import GenericBody
from tci.errors import CommandError, TciError
from tci.messages import Contact, Perception
from tci.messages.frames import Array, apply, invert, read_only, rpy_of, transform
from tci.recording.perceived import perceive
from tci.recording.recording import Recording
from tci.robot.description import Robot
from tci.skin.surfaces import Surface

FEWEST = 10
"""Least number of touches from which a mount is estimated. Three touches determine a pose, but the error of
each touch is as large as the distance between taxels. Assumed: ten touches average these errors out."""
SPREAD = 0.005
"""Least standard deviation [m] of the touches along their second principal axis. Assumed: from touches on one
line, the rotation about this line can't be determined."""
OUTLIER, ROUNDS = 3.0, 10
"""OUTLIER: a touch is left out if its residual exceeds this multiple of the median residual. ROUNDS: largest
number of rounds in which touches are left out. Assumed: a touch by another object has a far larger
residual."""


TURNS, SETTLED = 200, 1e-7
"""The fit alternates between the pose of a skin and the depth to which the touches press both skins into each
other. TURNS: largest number of alternations. SETTLED: the alternation ends when the depth changes by less
than this distance [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class SelfTouch:
    """One touch between the skin that is to be located and another skin of the robot."""

    reported: Array
    """Place (3,) [m] of the touch as reported by the skin to be located, in the frame of the link that
    carries this skin."""
    normal: Array
    """Outward unit normal (3,) of the skin to be located, at the place `reported`, in the frame of its link.
    """
    met: Array
    """Place (3,) [m] of the touch as reported by the other skin, in the frame of the link that carries the
    skin to be located."""


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Correction that moves a skin to its true place on its link, computed from touches."""

    correction: Array
    """Pose (4, 4) in the frame of the link. The corrected pose of the skin is this pose times the pose in the
    description."""
    residual: float
    """Root mean square distance [m] between the two places that the two skins report for each touch, with
    `correction` and `depth` taken into account."""
    depth: float
    """Mean depth [m] to which the skins were pressed into each other."""
    before: float
    """Root mean square distance [m] between the two places that the two skins report for each touch, without
    correction."""
    touches: int
    """Number of touches that were used."""
    left_out: int
    """Number of touches that were left out because their residual was too large."""

    moved: float
    """Mean distance [m] by which the correction moves the touched places of the skin."""

    def facts(self) -> dict[str, Any]:
        """Returns all values as JSON values: lengths in mm, angles in degrees."""
        turn = self.correction[:3, :3]
        return {
            "touches": self.touches, "left_out": self.left_out,
            "residual_mm": 1e3 * self.residual,
            "depth_mm": 1e3 * self.depth, "apart_mm": 1e3 * self.before, "moved_mm": 1e3 * self.moved,
            "turned_deg": float(np.rad2deg(Rotation.from_matrix(turn).magnitude())),
            "xyz_m": self.correction[:3, 3].tolist(), "rpy_deg": np.rad2deg(rpy_of(turn)).tolist(),
        }  # fmt: skip


def find_mount(touches: Iterable[SelfTouch]) -> Mount:
    """Finds, by least squares, the rigid correction of a skin's pose with which both skins report one place
    for each touch.

    Raises TciError for fewer than FEWEST touches, or for touches that lie on a line.
    """
    rows = [(touch.reported, touch.normal, touch.met) for touch in touches]
    if len(rows) < FEWEST:
        raise TciError(
            f"{len(rows)} touches of this skin by another one; valid: {FEWEST} or more, better 100"
        )
    reported, normals, met = (np.array(vectors) for vectors in zip(*rows, strict=True))
    used = np.ones(len(rows), dtype=bool)
    for _ in range(ROUNDS):
        correction, depth = _fit(reported[used], normals[used], met[used])
        off = np.linalg.norm(apply(correction, reported - depth * normals) - met, axis=1)
        kept = off <= OUTLIER * max(float(np.median(off)), 1e-6)
        if (kept == used).all():
            break
        used = kept
    spread = float(np.linalg.svd(reported[used] - reported[used].mean(axis=0))[1][1] / np.sqrt(used.sum()))
    if used.sum() < FEWEST or spread < SPREAD:
        raise TciError(
            f"{int(used.sum())} touches that agree, spread by {1e3 * spread:.1f} mm; valid: {FEWEST} or "
            f"more, spread by {1e3 * SPREAD:g} mm or more in two directions"
        )
    before = np.linalg.norm(reported - met, axis=1)[used]
    return Mount(
        read_only(correction), float(np.sqrt(np.mean(off[used] ** 2))), depth,
        float(np.sqrt(np.mean(before**2))), int(used.sum()), int((~used).sum()),
        float(np.linalg.norm(apply(correction, reported[used]) - reported[used], axis=1).mean()),
    )  # fmt: skip


def mount_in_recording(path: Path, robot: Robot, patch: str) -> Mount:
    """Returns the correction of a patch's pose on its link, computed from a recording in which the robot
    touches itself.

    Raises UnknownNameError if the robot has no such patch, RecordingError if the file can't be read, and
    TciError for too few touches.
    """
    robot.patch(patch)
    body, recording = GenericBody(robot), Recording(path)
    perceived = (period.perception for period in perceive(recording, robot))
    return find_mount(self_touches(body, patch, perceived))


def write_mounted(robot: Robot, patch: str, mount: Mount, out: Path) -> None:
    """Writes a description that extends the robot's description and corrects the place of one patch.

    Raises CommandError if `out` exists or is not in the folder of the robot's description.
    """
    source = Path(robot.source)
    if out.absolute().parent != source.absolute().parent or out.exists():
        raise CommandError(
            f"{out} can't extend {source.name}; valid: a new file in {source.absolute().parent}, "
            "or a copy of that folder"
        )
    moved = moved_patch(robot, patch, mount.correction).patch(patch)
    root = etree.Element("generic_robot", version="1", name=robot.name, angle_unit="deg", extends=source.name)
    rpy = np.rad2deg(moved.rpy)
    etree.SubElement(
        etree.SubElement(root, "skin"), "patch", name=patch,
        xyz=" ".join(f"{value:.6f}" for value in moved.xyz), rpy=" ".join(f"{value:.4f}" for value in rpy),
    )  # fmt: skip
    etree.indent(root)
    out.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n")


def self_touches(body: GenericBody, patch: str, perceptions: Iterable[Perception]) -> Iterator[SelfTouch]:
    """Yields one touch for each interval in which `patch` and a skin on another link are pressed together.

    A perception counts only if `patch` has one contact, and all skins on other links together have one
    contact. In each such interval, the perception with the most pressed taxels is used.
    """
    surfaces, chain = body.skin.surfaces, body.skin.kinematics
    link = surfaces[patch].link
    best: tuple[int, SelfTouch] | None = None
    for perception in perceptions:
        own = [one for one in perception.contacts if one.patch == patch]
        others = [one for one in perception.contacts if surfaces[one.patch].link != link]
        if len(own) != 1 or len(others) != 1:
            if best is not None:
                yield best[1]
            best = None
            continue
        size = len(own[0].taxels) + len(others[0].taxels)
        if best is not None and size <= best[0]:
            continue
        other = surfaces[others[0].patch]
        assert perception.joints is not None  # a Perceiver always sets `joints`
        poses = chain.poses(perception.joints.position, [link, other.link])
        met = apply(invert(poses[link]) @ poses[other.link], _centre(other, others[0])[0])
        best = size, SelfTouch(*_centre(surfaces[patch], own[0]), met)
    if best is not None:
        yield best[1]


def moved_patch(robot: Robot, patch: str, correction: Array) -> Robot:
    """Returns the robot with `patch` moved relative to its link by the pose `correction` (4, 4)."""
    own = robot.patch(patch)
    mount = correction @ own.mount
    moved = own.model_copy(update={"xyz": tuple(mount[:3, 3].tolist()), "rpy": rpy_of(mount[:3, :3])})
    patches = tuple(moved if one is own else one for one in robot.patches)
    return robot.model_copy(update={"patches": patches})


def _centre(surface: Surface, contact: Contact) -> tuple[Array, Array]:
    """Returns the centre (3,) [m] of a contact's pressed taxels, projected onto the surface of the skin, and
    the normal (3,) there. All pressed taxels have equal weight."""
    points, normals = surface.project(surface.positions[contact.taxels].mean(axis=0)[None])
    return points[0], normals[0]


def _fit(reported: Array, normals: Array, met: Array) -> tuple[Array, float]:
    """Fits the place of a skin on its link to n touches by another skin, by least squares. Returns the
    correction as a pose (4, 4), and the mean depth [m] to which the touches press the skins into each other.

    `reported` and `met` (n, 3) [m] are the places of the touches as this skin and the other skin measure
    them; `normals` (n, 3) are this skin's normals. For a flat skin the depth can't be determined and stays 0.
    """
    depth = 0.0
    for _ in range(TURNS):
        pose, before = _rigid(reported - depth * normals, met), depth
        away = reported - apply(invert(pose), met)
        depth = float(np.einsum("ni,ni->n", away, normals).mean())
        if abs(depth - before) < SETTLED:
            break
    return pose, depth


def _rigid(reported: Array, met: Array) -> Array:
    """Returns the pose (4, 4) that moves the points `reported` (n, 3) onto the points `met` (n, 3) with the
    least squared error (Kabsch 1976)."""
    here, there = reported.mean(axis=0), met.mean(axis=0)
    R = Rotation.align_vectors(met - there, reported - here)[0].as_matrix()
    return transform(R, there - R @ here)
