"""The skin of a robot as a sensor of mjlab: the normal force on every taxel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
import warp as wp
from mjlab.sensor import Sensor, SensorCfg

from mjlab_tci import feel
from mjlab_tci.skin import G1, read_skin

TOUCHES = 2
"""Collision bit of what touches the skin. mjlab's robots, things and floors have another, 1."""
SLOTS = int(feel.SLOTS)
"""Contacts on one patch at a time."""
_FIELDS = sum(
    1 << int(getattr(mujoco.mjtConDataField, f"mjCONDATA_{name}"))
    for name in ("FOUND", "FORCE", "POS", "NORMAL", "TANGENT")
)
_MOST_FORCE = 2  # MuJoCo's code: contacts sorted by force


@dataclass
class SkinSensorCfg(SensorCfg):
    """The skin of an entity, for `SceneCfg.sensors`.

    Gives `Sensor[torch.Tensor]`: forces (worlds, taxels) [N].
    """

    entity: str = "robot"
    """Entity that wears the skin."""
    skin: str | Path = G1
    """File of `tci skin export NAME --to json`."""
    touched_by: int = TOUCHES
    """Geoms touch the skin whose `contype` has one of these bits."""

    def build(self) -> SkinSensor:
        return SkinSensor(self)


class SkinSensor(Sensor[torch.Tensor]):
    """Spreads what MuJoCo's contact sensors report over the taxels around each contact, as TCI does."""

    def __init__(self, cfg: SkinSensorCfg) -> None:
        super().__init__()
        self.cfg = cfg
        self.patches = read_skin(cfg.skin)
        ends = np.cumsum([len(one.positions) for one in self.patches]).tolist()
        self.places = {
            one.name: slice(end - len(one.positions), end)
            for one, end in zip(self.patches, ends, strict=True)
        }
        """Columns of each patch."""

    def named(self, patch: str) -> str:
        """Name in MuJoCo of the geom, mesh and contact sensor of a patch."""
        return f"{self.cfg.name}/{patch}"

    def edit_spec(self, scene_spec: mujoco.MjSpec, entities: dict[str, Any]) -> None:
        if self.cfg.entity not in entities:
            raise ValueError(f"{self.cfg.name}: entity {self.cfg.entity!r}; valid: {', '.join(entities)}")
        for one in self.patches:
            name, link = self.named(one.name), f"{self.cfg.entity}/{one.link}"
            body = scene_spec.body(link)
            if body is None:
                raise ValueError(f"{name}: no body {link}; valid: a skin of this robot")
            scene_spec.add_mesh(name=name, uservert=one.solid.ravel())
            body.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0.0, contype=0,
                conaffinity=self.cfg.touched_by, condim=1, group=2, rgba=[0.22, 0.23, 0.25, 1.0],
            )  # fmt: skip
            scene_spec.add_sensor(
                name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_GEOM,
                objname=name, intprm=[_FIELDS, _MOST_FORCE, SLOTS],
            )  # fmt: skip

    def initialize(self, mj_model: mujoco.MjModel, model: Any, data: Any, device: str) -> None:
        self._data = getattr(data, "struct", data)
        self._device = wp.get_device(device)
        rows = []
        for one in self.patches:
            name, place = self.named(one.name), self.places[one.name]
            rows.append({
                "sensor": int(mj_model.sensor(name).adr[0]), "body": int(mj_model.geom(name).bodyid[0]),
                "begin": place.start, "end": place.stop, "width": one.width,
            })  # fmt: skip
        count = rows[-1]["end"]
        with wp.ScopedDevice(self._device):
            self._patches = feel.structs(feel.Patch, rows, self._device)
            self._positions, self._normals = (
                wp.array(np.concatenate([getattr(one, field) for one in self.patches]), dtype=wp.vec3)
                for field in ("positions", "normals")
            )
            self._due = wp.array(np.ones(len(rows)), dtype=int)
            self._full = wp.zeros(1, dtype=int)
            self._forces = wp.zeros((self._data.nworld, count), dtype=float)
        self._tensor = wp.to_torch(self._forces)
        lengths = [len(one.positions) for one in self.patches]
        owners = np.repeat([row["body"] for row in rows], lengths)
        self._bodies = torch.as_tensor(owners, device=self._tensor.device)

    @property
    def data(self) -> torch.Tensor:
        """Forces (worlds, taxels) [N], always in the same memory.

        Never from mjlab's cache: mjlab brings contacts up to date between rewards and observations without
        telling sensors.
        """
        return self._compute_data()

    def _compute_data(self) -> torch.Tensor:
        data = self._data
        with wp.ScopedDevice(self._device):
            self._forces.zero_()
            wp.launch_tiled(
                feel.feel, dim=(data.nworld, len(self.patches), SLOTS), block_dim=feel.LANES,
                inputs=[
                    self._due, self._patches, data.sensordata, data.xpos, data.xmat, self._positions,
                    self._normals, self._forces, self._full,
                ],
            )  # fmt: skip
        return self._tensor

    def taxels_in_world(
        self, env_ids: torch.Tensor, taxels: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Present positions (k, 3) [m] and outward normals (k, 3) of one taxel in each of some worlds."""
        body = self._bodies[taxels]
        turn = wp.to_torch(self._data.xmat)[env_ids, body].reshape(-1, 3, 3)
        points, normals = (
            torch.einsum("kij,kj->ki", turn, wp.to_torch(one)[taxels])
            for one in (self._positions, self._normals)
        )
        return wp.to_torch(self._data.xpos)[env_ids, body] + points, normals

    def check(self) -> None:
        """Raises RuntimeError if a patch had more contacts at a time than `SLOTS`, which it does not feel.
        Waits for the device, so `data` does not."""
        if world := int(self._full.numpy()[0]):
            raise RuntimeError(f"world {world - 1}: more than {SLOTS} contacts on one patch at once")
