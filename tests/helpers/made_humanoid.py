"""Creates a small humanoid as a URDF for tests of proposals. Its joints, limits and shapes are arguments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco

ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch")
AXES = {
    "shoulder_pitch": "0 1 0", "shoulder_roll": "1 0 0", "shoulder_yaw": "0 0 1", "elbow": "0 1 0",
    "wrist_roll": "0 0 1", "wrist_pitch": "0 1 0", "hip_roll": "1 0 0", "hip_yaw": "0 0 1", "knee": "0 1 0",
    "ankle_pitch": "0 1 0", "ankle_roll": "1 0 0", "yaw": "0 0 1", "pitch": "0 1 0", "roll": "1 0 0",
}  # fmt: skip
AHEAD = {
    "shoulder_pitch": "0 0 1", "shoulder_roll": "0 1 0", "shoulder_yaw": "1 0 0", "wrist_roll": "1 0 0"
}  # fmt: skip
"""Joint axes of arms that point forward at the model's zero, with elbows that bend down, as on Baxter."""


class MadeHumanoid:
    """Writes the parts of a humanoid that is 0.9 m tall. Its root is the pelvis or, with `from_torso`, the
    torso."""

    def __init__(
        self,
        *,
        arm: Sequence[str] = ARM,
        elbow: tuple[float, float] = (-2.2, 0.1),
        slant: float = 0.0,
        head: Sequence[str] = ("yaw", "pitch"),
        from_torso: bool = False,
        names: bool = True,
        legs: bool = True,
        mesh: str = "",
        ahead: bool = False,
    ) -> None:
        self._words: list[str] = []
        self._names = names
        self._mesh = mesh
        self._link("torso" if from_torso else "pelvis", 0.1, 8.0)
        above, below = "torso", "pelvis"
        if from_torso:
            below = self._chain("torso", ["waist_yaw"], ["0 0 0"], axes=["0 0 1"])
        else:
            above = self._chain("pelvis", ["waist_yaw"], ["0 0 0.1"], axes=["0 0 1"])
        joints = [f"head_{number}_{axis}" for number, axis in enumerate(head)]
        # The shape is beside the median plane, but it lies on the axis of a pitch joint, so it still
        # intersects the plane.
        y = [0.0, *(0.03 if axis == "pitch" else 0.0 for axis in head)]
        aside = [f"0 {y[i + 1] - y[i]} {0.06 if i else 0.4}" for i in range(len(head))]
        self._chain(above, joints, aside, axes=[AXES[axis] for axis in head])
        places = ("0 0.15 0.3", "0 0.02 0", "0 0 -0.05", "0 0 -0.15", "0 0 -0.1", "0 0 -0.1")
        steps = dict(zip(ARM, places, strict=True))
        for side, sign in (("left", 1), ("right", -1)):
            own = [steps[name] for name in arm]
            if ahead:
                turned = [f"{-float(z)} {y} 0" for _, y, z in (step.split() for step in own[1:])]
                limits = {"shoulder_roll": (-2.1, 1.05), "shoulder_yaw": (-3.05, 3.05), "elbow": (-0.05, 2.6)}
                self._limb(above, side, sign, arm, [own[0], *turned], axes=AHEAD, limits=limits, ahead=True)
            else:
                self._limb(above, side, sign, arm, own, limits={"elbow": elbow})
            if legs:
                hip = f"0 {(1 - slant**2) ** 0.5} {-slant * sign}"
                leg = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
                down = ("0 0.08 -0.05", "0 0.02 0", "0 0 -0.05", "0 0 -0.2", "0 0 -0.25", "0 0 0")
                self._limb(below, side, sign, leg, down, axes={"hip_pitch": hip})

    def urdf(self, folder: Path) -> Path:
        """Writes the URDF into a folder."""
        path = folder / "made.urdf"
        path.write_text(f"<robot name='made'>{''.join(self._words)}</robot>")
        return path

    def mjcf(self, folder: Path) -> Path:
        """Writes MuJoCo's export of the URDF into a folder."""
        path = folder / "made.xml"
        path.write_text(mujoco.MjSpec.from_file(str(self.urdf(folder))).to_xml())
        return path

    def _limb(
        self, parent: str, side: str, sign: int, names: Sequence[str], steps: Sequence[str], *,
        axes: dict[str, str] | None = None, limits: dict[str, tuple[float, float]] | None = None,
        ahead: bool = False,
    ) -> None:  # fmt: skip
        mirrored = []
        for step in steps:
            x, y, z = step.split()
            mirrored.append(f"{x} {float(y) * sign} {z}")
        full = [f"{side}_{name}" if self._names else f"{side}_{steps[0]}_{number}".replace(" ", "_")
                for number, name in enumerate(names)]  # fmt: skip
        self._chain(
            parent, full, mirrored, axes=[(axes or {}).get(name) or AXES[name] for name in names],
            limits=[(limits or {}).get(name, (-1.5, 1.5)) for name in names], ahead=ahead,
        )  # fmt: skip

    def _chain(
        self, parent: str, names: Sequence[str], steps: Sequence[str], *, axes: Sequence[str],
        limits: Sequence[tuple[float, float]] = (), ahead: bool = False,
    ) -> str:  # fmt: skip
        for number, (name, step, axis) in enumerate(zip(names, steps, axes, strict=True)):
            link = {"waist_yaw": "torso" if parent == "pelvis" else "pelvis"}.get(name, f"{name}_link")
            lower, upper = limits[number] if limits else (-1.0, 1.0)
            self._link(link, 0.03, 0.5 if link not in ("torso", "pelvis") else 8.0, ahead=ahead)
            self._words.append(
                f"<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{link}'/>"
                f"<origin xyz='{step}'/><axis xyz='{axis}'/>"
                f"<limit lower='{lower}' upper='{upper}' effort='30' velocity='6.28'/></joint>"
            )
            parent = link
        return parent

    def _link(self, name: str, radius: float, mass: float, *, ahead: bool = False) -> None:
        place = "xyz='0.08 0 0' rpy='0 1.5707963 0'" if ahead else "xyz='0 0 -0.08'"
        shape = f"<cylinder radius='{radius}' length='0.2'/>"
        if self._mesh:
            shape = f"<mesh filename='{self._mesh}/{name}.stl'/>"
        self._words.append(
            f"<link name='{name}'><inertial><origin xyz='0 0 -0.05'/><mass value='{mass}'/>"
            "<inertia ixx='.01' iyy='.01' izz='.01' ixy='0' ixz='0' iyz='0'/></inertial>"
            f"<collision><origin {place}/><geometry>{shape}</geometry></collision></link>"
        )
