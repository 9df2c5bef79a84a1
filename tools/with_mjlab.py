"""Shows the skin as a force sensor in genuine mjlab, and that it feels what TCI's own skin feels.

python tools/with_mjlab.py press out/mjlab.npz   in an environment with mjlab_tci: presses its G1 in 4 worlds
python tools/with_mjlab.py judge out/mjlab.npz   in TCI's: its scalar skin, given MuJoCo's state of each step

`make mjlab` runs both.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

WORLDS = 4
SECONDS = 1.0
PRESSES = {"left_forearm": 1.0, "right_forearm": 2.0, "left_upper_arm": 3.0, "right_upper_arm": 5.0}
"""Force [N] on one patch in each world."""
MOST = 2e-5
"""Largest difference from TCI's skin, as a share of the most loaded taxel: single precision."""


def press(out: Path) -> bool:
    """Presses one taxel in each world, and keeps what MuJoCo and the sensor say at the end of each step."""
    import torch
    import warp
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.tasks.registry import load_env_cfg
    from mjlab_tci.finger import RADIUS
    from mjlab_tci.finger import press as press_taxels

    warp.config.log_level = warp.LOG_WARNING
    print("the first time, kernels are compiled: half a minute", flush=True)
    cfg = load_env_cfg("TCI-Yield-Unitree-G1")
    cfg.scene.num_envs, cfg.events = WORLDS, {"start": cfg.events["start"]}
    cfg.episode_length_s = 10.0  # no reset meanwhile
    env = ManagerBasedRlEnv(cfg, device="cpu")
    env.reset()
    rest = torch.zeros((WORLDS, env.action_manager.total_action_dim))
    skin = env.scene["skin"]
    assert float(skin.data.abs().max()) == 0.0, "untouched skin feels a force"
    chance = np.random.default_rng(49)
    names = [*PRESSES]
    patches = {one.name: one for one in skin.patches}
    own = [int(chance.choice(inner_taxels(patches[name].positions))) for name in names]
    columns = torch.tensor([skin.places[name].start + k for name, k in zip(names, own, strict=True)])
    press_taxels(env, torch.arange(WORLDS), columns, torch.tensor([*PRESSES.values()]))
    data, kept = env.sim.wp_data, {"sensors": [], "centres": [], "turns": [], "force": [], "angles": []}
    model = env.sim.mj_model
    address = [model.sensor(skin.named(one.name)).adr[0] for one in skin.patches]
    length = model.sensor(skin.named(names[0])).dim[0]
    bodies = [model.body(f"robot/{one.link}").id for one in skin.patches]
    for _ in range(round(SECONDS / env.step_dt)):
        seen = env.step(rest)[0]
        force = seen["actor"][:, -skin.data.shape[1] :].numpy()
        sensors = data.sensordata.numpy()
        kept["sensors"].append(np.stack([sensors[:, at : at + length] for at in address], axis=1))
        kept["centres"].append(data.xpos.numpy()[:, bodies])
        kept["turns"].append(data.xmat.numpy().reshape(WORLDS, -1, 9)[:, bodies])
        kept["force"].append(force.copy())
        kept["angles"].append(env.scene["robot"].data.joint_pos.numpy().copy())
    skin.check()
    out.parent.mkdir(parents=True, exist_ok=True)
    torso = model.body("robot/torso_link").id
    np.savez(
        out, patches=[one.name for one in skin.patches], joints=env.scene["robot"].joint_names,
        torso=np.column_stack([data.xpos.numpy()[:, torso], data.xmat.numpy()[:, torso].reshape(-1, 9)]),
        **kept,
    )  # fmt: skip
    tip = model.body("finger/tip").id
    tips, axes = data.xpos.numpy()[:, tip], data.xmat.numpy()[:, tip].reshape(WORLDS, 3, 3)[:, :, 2]
    print("world  patch             pressed with  skin feels  along finger  within 15 mm of it  slid by")
    good = True
    for w, (name, newtons) in enumerate(PRESSES.items()):
        p = [*patches].index(name)
        felt, under = kept["force"][-1][w], kept["sensors"][-1][w, p]
        turn = kept["turns"][-1][w, p].reshape(3, 3)
        spot, positions = (tips[w] - kept["centres"][-1][w, p]) @ turn, patches[name].positions
        near = np.linalg.norm(positions - spot, axis=1) <= 0.015 + RADIUS
        along = float(felt.sum() * (under[7:10] @ -axes[w]))  # the contact's normal
        there = float(felt[skin.places[name]][near].sum() / max(felt.sum(), 1e-9))
        slid = 1000.0 * max(float(np.linalg.norm(positions[own[w]] - spot)) - RADIUS, 0.0)
        good &= abs(along - newtons) <= 0.1 * newtons and there >= 0.9
        print(
            f"{w:5}  {name:16}  {newtons:10.1f} N  {felt.sum():8.2f} N  {along:10.2f} N  {there:18.0%}  "
            f"{slid:4.0f} mm"
        )
    return good


def inner_taxels(positions: np.ndarray) -> np.ndarray:
    """Those with the most taxels around them: off the ends, where a finger would slide off."""
    around = (np.linalg.norm(positions[:, None] - positions[None], axis=2) <= 0.025).sum(axis=1)
    return np.flatnonzero(around >= np.quantile(around, 0.75))


def judge(out: Path) -> bool:
    """TCI's compiled scalar loop on the same contacts and poses."""
    from tci.robot.catalogue import load_robot
    from tci.robot.kinematics import KinematicChain
    from tci.simulation import sampling as at
    from tci.simulation.world import World

    found = np.load(out)
    world = World("g1")
    arrays = world.taxels.arrays
    sensors, centres, turns, rows, load = *arrays[:4], arrays[8]
    worst, loaded, largest = 0.0, 0, 0.0
    for frame in range(len(found["force"])):
        for w in range(WORLDS):
            expected = np.zeros(load.shape[1])
            for p, name in enumerate(found["patches"].tolist()):
                number = world.taxels.worn[name]
                one, start = rows[number], rows[number]["sensor"]
                values = found["sensors"][frame, w, p]
                sensors[start : start + len(values)] = values
                centres[one["body"]], turns[one["body"]] = (
                    found["centres"][frame, w, p],
                    found["turns"][frame, w, p],
                )
                load[:] = 0.0
                at.sample_now(number, -1, arrays)
                expected[one["begin"] : one["end"]] = load[at.PRESSING, : one["end"] - one["begin"]]
            if expected.max() > 0.01:
                loaded += 1
                largest = max(largest, float(expected.max()))
                error = np.abs(found["force"][frame, w] - expected).max()
                worst = max(worst, float(error / expected.max()))
            else:
                assert found["force"][frame, w].max() <= 0.01, "felt in mjlab, not in TCI"
    robot, off = load_robot("g1"), 0.0
    chain, servos = KinematicChain(robot), [one.name for one in robot.servos]
    for w in range(WORLDS):
        angles = np.zeros(len(servos))
        for name, angle in zip(found["joints"].tolist(), found["angles"][-1, w], strict=True):
            angles[servos.index(name)] = angle
        links = [world.surfaces[name].link for name in found["patches"].tolist()]
        poses = chain.poses(angles, ["torso_link", *links])
        T_WT = np.eye(4)
        T_WT[:3, 3], T_WT[:3, :3] = found["torso"][w, :3], found["torso"][w, 3:].reshape(3, 3)
        for p, link in enumerate(links):
            T_WL = T_WT @ np.linalg.inv(poses["torso_link"]) @ poses[link]
            off = max(off, float(np.abs(T_WL[:3, 3] - found["centres"][-1, w, p]).max()))
    print(
        f"{loaded} pressed frames, up to {largest:.2f} N on a taxel: differences at most {worst:.1e} of the "
        f"most loaded taxel (bar {MOST:g}); links at most {1000.0 * off:.3f} mm from those of TCI's G1"
    )
    return loaded > 0 and worst <= MOST and off <= 1e-4


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("press", "judge"))
    parser.add_argument("file", type=Path)
    given = parser.parse_args()
    raise SystemExit(0 if {"press": press, "judge": judge}[given.part](given.file) else 1)
