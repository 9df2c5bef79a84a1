"""A finger that presses the skin with a given force."""

from __future__ import annotations

import mujoco
import torch
from mjlab.actuator import BuiltinMotorActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnv

from mjlab_tci.sensor import TOUCHES, SkinSensor

RADIUS, MASS = 0.005, 0.02
DAMPING = 10.0
"""Of the way along which it pushes [N s/m]: a limb that gives way at 2 cm/s feels 0.2 N less."""
GAP = 0.002
"""Between tip and skin before a press [m]."""
AWAY = 10.0
"""Where fingers are at rest: below the ground [m]."""
REACH, MOST = 0.2, 100.0
"""Way [m] and force [N] of the tip at most."""


def finger_cfg() -> EntityCfg:
    """A sphere of 10 mm without weight or friction; it slides along the z axis of its base and touches
    nothing but skin."""
    return EntityCfg(
        spec_fn=_finger,
        init_state=EntityCfg.InitialStateCfg(pos=(0.0, 0.0, -AWAY)),
        articulation=EntityArticulationInfoCfg(
            actuators=(BuiltinMotorActuatorCfg(target_names_expr=("push",), effort_limit=MOST),)
        ),
    )


def _finger() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    tip = spec.worldbody.add_body(name="tip", gravcomp=1.0)
    tip.add_joint(
        name="push", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0], damping=DAMPING,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[0.0, REACH],
    )  # fmt: skip
    tip.add_geom(
        name="tip", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0.0, 0.0], mass=MASS, contype=TOUCHES,
        conaffinity=0, condim=1, priority=1, solref=[0.004, 1.0],
    )  # fmt: skip
    return spec


def press(
    env: ManagerBasedRlEnv,
    env_ids: torch.Tensor,
    taxels: torch.Tensor,
    newtons: torch.Tensor,
    *,
    sensor: str = "skin",
    finger: str = "finger",
) -> None:
    """Has the finger of some worlds press one taxel each from now on, along its inward normal.

    Args:
        env: The environment.
        env_ids: Worlds (k,).
        taxels: Columns (k,) of the sensor.
        newtons: Forces (k,) [N], at most `MOST`.
        sensor: Name of the skin.
        finger: Name of the finger.
    """
    skin: SkinSensor = env.scene[sensor]
    points, normals = skin.taxels_in_world(env_ids, taxels)
    pose = torch.cat([points + (RADIUS + GAP) * normals, _turned(-normals)], dim=1)
    hand = env.scene[finger]
    hand.write_mocap_pose_to_sim(pose, env_ids)
    nothing = torch.zeros((len(env_ids), 1), device=env.device)
    hand.write_joint_state_to_sim(nothing, nothing, env_ids=env_ids)
    hand.set_joint_effort_target(newtons[:, None], env_ids=env_ids)


def press_anywhere(
    env: ManagerBasedRlEnv,
    env_ids: torch.Tensor | None,
    newtons: tuple[float, float] = (2.0, 10.0),
    sensor: str = "skin",
    finger: str = "finger",
) -> None:
    """Event: presses a taxel drawn in each world, with a force [N] drawn from a range."""
    ids = torch.arange(env.num_envs, device=env.device) if env_ids is None else env_ids
    env.sim.forward()  # after a reset, links are elsewhere
    count = env.scene[sensor].data.shape[1]
    taxels = torch.randint(count, (len(ids),), device=env.device)
    force = torch.empty(len(ids), device=env.device).uniform_(*newtons)
    press(env, ids, taxels, force, sensor=sensor, finger=finger)


def _turned(z: torch.Tensor) -> torch.Tensor:
    """Quaternions (k, 4) that turn the z axis to directions (k, 3)."""
    half = torch.stack([1.0 + z[:, 2], -z[:, 1], z[:, 0], torch.zeros_like(z[:, 0])], dim=1)
    over = torch.tensor([0.0, 1.0, 0.0, 0.0], device=z.device).expand_as(half)
    half = torch.where(half[:, :1] > 1e-6, half, over)
    return half / half.norm(dim=1, keepdim=True)
