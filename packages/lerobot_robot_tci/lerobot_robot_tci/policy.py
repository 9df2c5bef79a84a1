"""A policy that LeRobot trained on a set of TCI as a capability of TCI."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.utils.constants import OBS_ENV_STATE, OBS_STATE

from tci import GenericBody, PolicyCapability
from tci.capabilities.policy import Observation, PolicySpec, View
from tci.errors import TciError
from tci.learn.names import Names
from tci.robot.like import RobotLike, as_robot


def policy_capability(
    folder: str | Path, robot: RobotLike, part: str = "left_arm", *, rate: float = 30.0, latency: float = 0.05
) -> PolicyCapability:
    """Runs a policy of `lerobot-train` on the robot whose sets of `tci log export` it learned from.

    Args:
        folder: `pretrained_model` of a checkpoint.
        robot: The robot.
        part: Generic part that it moves; what it says of others is not ordered.
        rate: Rows per second of its set.
        latency: Time [s] that it has to compute.

    Raises TciError for a policy that sees something else than `observation.state` and
    `observation.environment_state`, or gives another number of angles, and the errors of `load_robot`.
    """
    described = as_robot(robot)
    names = Names(GenericBody(described), ["all"], ["posture"])
    config = PreTrainedConfig.from_pretrained(folder)
    given = config.output_features["action"].shape
    if unknown := set(config.input_features) - {OBS_STATE, OBS_ENV_STATE}:
        raise TciError(f"{folder} sees {', '.join(unknown)}; valid: {OBS_STATE}, {OBS_ENV_STATE}")
    if given != (len(names.actions),):
        raise TciError(
            f"{folder} moves {given} joints; valid: {len(names.actions)}, those of {described.name}"
        )
    policy = get_policy_class(config.type).from_pretrained(folder)
    policy.eval()
    before, after = make_pre_post_processors(config, str(folder))
    see = {OBS_STATE: Observation(lambda view: _state(names, view)), OBS_ENV_STATE: Observation(_forces)}
    order = [name for name in see if name in config.input_features]
    sizes = [config.input_features[name].shape[0] for name in order]
    own = [(n, names.actions.index(f"{name}.pos")) for n, name in names.joints[part]]
    chunk, servos = config.n_action_steps, described.part(part).servos

    def act(seen: Any) -> Any:
        values = np.split(np.asarray(seen, np.float32), np.cumsum(sizes)[:-1])
        batch = {name: torch.from_numpy(one)[None] for name, one in zip(order, values, strict=True)}
        with torch.inference_mode():
            found = after(policy.predict_action_chunk(before(batch)))[0, :chunk].numpy()
        angles = np.zeros((chunk, len(servos)))
        for n, place in own:
            angles[:, n] = found[:, place]
        return angles

    spec = PolicySpec(
        observations=tuple(order), kind=described.part(part).kind, joints=tuple(one.name for one in servos),
        relative=False, rate=rate, chunk=chunk, latency=latency, limit=7.0,
    )  # fmt: skip
    return PolicyCapability(act, spec, parts=(part,), observations={name: see[name] for name in order})


def _state(names: Names, view: View) -> Any:
    return [*names.angles(view.perception.posture).values()]


def _forces(view: View) -> Any:
    """Force [N] on each taxel, as the sets have it."""
    skin, surfaces = view.perception.skin, view.body.skin.surfaces
    if skin is None:
        return np.zeros(sum(len(surfaces[one.name].areas) for one in view.body.robot.patches))
    patches = enumerate(view.body.robot.patches)
    return np.concatenate([skin.on(p) * surfaces[one.name].areas for p, one in patches])
