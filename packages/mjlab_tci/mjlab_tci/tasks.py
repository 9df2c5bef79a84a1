"""Task `TCI-Yield-Unitree-G1`: a held G1 whose arms give way to fingers that press their skin."""

from __future__ import annotations

import mujoco
import torch
from mjlab.asset_zoo.robots import G1_ACTION_SCALE, get_g1_robot_cfg
from mjlab.asset_zoo.robots.unitree_g1.g1_constants import get_spec
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg, mdp
from mjlab.envs.mdp.actions import JointPositionActionCfg
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.observation_manager import ObservationGroupCfg, ObservationTermCfg
from mjlab.managers.reward_manager import RewardTermCfg
from mjlab.managers.termination_manager import TerminationTermCfg
from mjlab.rl import RslRlModelCfg, RslRlOnPolicyRunnerCfg, RslRlPpoAlgorithmCfg
from mjlab.scene import SceneCfg
from mjlab.sim import MujocoCfg, SimulationCfg
from mjlab.tasks.registry import register_mjlab_task

from mjlab_tci.finger import finger_cfg, press_anywhere
from mjlab_tci.sensor import SkinSensorCfg

TASK = "TCI-Yield-Unitree-G1"
ARMS = r".*_(shoulder|elbow|wrist)_.*"


def skin_force(env: ManagerBasedRlEnv, sensor: str = "skin") -> torch.Tensor:
    """Observation: forces (worlds, taxels) [N]."""
    return env.scene[sensor].data.clone()


def pressing(env: ManagerBasedRlEnv, sensor: str = "skin") -> torch.Tensor:
    """Reward term: force [N] on the whole skin."""
    return env.scene[sensor].data.sum(dim=1)


def yield_cfg() -> ManagerBasedRlEnvCfg:
    robot = get_g1_robot_cfg()
    robot.spec_fn = _held
    terms = {
        "joints": ObservationTermCfg(func=mdp.joint_pos_rel),
        "speeds": ObservationTermCfg(func=mdp.joint_vel_rel),
        "skin": ObservationTermCfg(func=skin_force),
    }
    return ManagerBasedRlEnvCfg(
        scene=SceneCfg(
            entities={"robot": robot, "finger": finger_cfg()},
            sensors=(SkinSensorCfg("skin", entity="robot"),),
        ),
        observations={"actor": ObservationGroupCfg(terms), "critic": ObservationGroupCfg({**terms})},
        actions={
            "arms": JointPositionActionCfg(
                entity_name="robot", actuator_names=(ARMS,), use_default_offset=True,
                scale={name: scale for name, scale in G1_ACTION_SCALE.items() if _of_arm(name)},
            )
        },
        events={
            "start": EventTermCfg(func=mdp.reset_scene_to_default, mode="reset"),
            "press": EventTermCfg(func=press_anywhere, mode="reset"),
        },
        rewards={
            "pressed": RewardTermCfg(func=pressing, weight=-0.1),
            "hurried": RewardTermCfg(func=mdp.action_rate_l2, weight=-0.01),
        },
        terminations={"time_out": TerminationTermCfg(func=mdp.time_out, time_out=True)},
        # Without weight, as in TCI: real servos hold it; mjlab's would sink first, away from the fingers.
        sim=SimulationCfg(
            nconmax=64, njmax=256, mujoco=MujocoCfg(timestep=0.002, gravity=(0.0, 0.0, 0.0))
        ),
        decimation=10,
        episode_length_s=2.0,
    )  # fmt: skip


def _of_arm(expression: str) -> bool:
    return any(word in expression for word in ("shoulder", "elbow", "wrist"))


def _held() -> mujoco.MjSpec:
    spec = get_spec()
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
            break
    return spec


def _rl_cfg() -> RslRlOnPolicyRunnerCfg:
    return RslRlOnPolicyRunnerCfg(
        actor=RslRlModelCfg(
            hidden_dims=(256, 128), obs_normalization=True,
            distribution_cfg={"class_name": "GaussianDistribution", "init_std": 1.0, "std_type": "scalar"},
        ),
        critic=RslRlModelCfg(hidden_dims=(256, 128), obs_normalization=True),
        algorithm=RslRlPpoAlgorithmCfg(),
        experiment_name="g1_yield",
        max_iterations=1000,
    )  # fmt: skip


register_mjlab_task(TASK, yield_cfg(), yield_cfg(), _rl_cfg())
