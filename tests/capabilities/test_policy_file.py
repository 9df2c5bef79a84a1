"""The policy that the tutorial trained runs from its file, on robots on which it was not trained."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers import ROOT
from helpers.command_line import tci as command
from tci.capabilities.fields import default_fields
from tci.capabilities.policy import PolicySpec, read_policy, write_policy
from tci.errors import TciError
from tci.messages import JointReading

try:
    import onnxruntime  # noqa: F401 - looks whether it is there
except ModuleNotFoundError:
    pytest.skip(
        "did not run: needs onnxruntime; to get it: make test, which installs the extra onnx",
        allow_module_level=True,
    )

WITHDRAW = ROOT / "examples" / "learning" / "withdraw.onnx"


@pytest.mark.parametrize("robot", ["nao", "icub", "g1"])
def test_it_leaves_touches_and_rests_before(robot: str) -> None:
    """Trained on NAO's left arm; 100 touches of each robot are in docs/learning.md."""
    capability, gone = tci.PolicyCapability(WITHDRAW), 0
    for seed in range(3):
        driver = tci.connect(robot, seed=seed)
        body, rows = tci.GenericBody(driver.robot), list[tuple[float, float, int, float]]()
        joints = driver.read().joints
        part = ("right_arm", "left_arm")[seed % 2]
        place = body.place(part, default_fields()[seed].place, joints)
        driver.world.finger.poke(place.patch, place.p_L, place.n_L, gap=0.03)

        def see(
            tick: tci.Tick,
            world: tci.World = driver.world,
            rows: list[tuple[float, float, int, float]] = rows,
            home: JointReading = joints,
        ) -> None:
            moved = float(np.abs(tick.reading.joints.position - home.position).max())
            rows.append((tick.now, world.finger.force, len(tick.sent.refusals), moved))

        tci.run(driver, capability, duration=1.3, observe=see)
        now, force, refused, moved = np.array(rows).T
        begin = now[force > 0.0][0]
        assert begin > 0.05
        assert np.rad2deg(moved[now < begin].max()) < 2.0
        assert force.max() > 1.0
        assert not refused.any()
        gone += bool((force[(now > begin + 0.02) & (now <= begin + 1.0)] == 0.0).any())
    assert gone == 3


def test_an_arm_that_nobody_touches_stays() -> None:
    """One that saw its own offset drifted by 16 degrees in 5 s."""
    driver = tci.connect("icub")
    home, moved = driver.read().joints.position, list[float]()

    def see(tick: tci.Tick) -> None:
        moved.append(float(np.abs(tick.reading.joints.position - home).max()))

    tci.run(driver, tci.PolicyCapability(WITHDRAW), duration=5.0, observe=see)
    assert np.rad2deg(max(moved)) < 2.0


def test_the_command_needs_the_file_alone() -> None:
    said = json.loads(command("run", str(WITHDRAW), "icub", "--poke", "--duration", "0.6", "--json"))
    assert said["touched_N"]
    assert said["moved_rad"]
    assert not said["refusals"]


def test_what_stands_in_the_file_is_what_was_written(tmp_path: Path) -> None:
    policy, spec = read_policy(WITHDRAW)
    assert (spec.rate, spec.history, spec.observations) == (25.0, 36, ("contacts",))
    assert len(spec.scale) == 28
    seen = np.linspace(-1.0, 1.0, 36 * 28)
    again = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(policy(seen), again(seen))
    bare = WITHDRAW.read_bytes().replace(b"tci.policy", b"no.policy!")
    write_policy(tmp_path / "mine.onnx", bare, spec)
    mine, read = read_policy(tmp_path / "mine.onnx")
    assert read == spec
    np.testing.assert_array_equal(mine(seen), policy(seen))
    for model, given, says in (
        (bare, PolicySpec(), "it has no scale"),
        (WITHDRAW, spec, "has a description already"),
        (b"", spec, "can't be loaded"),
        (bare, PolicySpec(("offset",), scale=[1.0] * 5, action_scale=[1.0] * 5), "can't be computed for 5"),
    ):
        with pytest.raises(TciError, match=says):
            write_policy(tmp_path / "other.onnx", model, given)
    assert not (tmp_path / "other.onnx").exists()
    (tmp_path / "bare.onnx").write_bytes(bare)
    with pytest.raises(TciError, match="does not say what it sees"):
        read_policy(tmp_path / "bare.onnx")
    with pytest.raises(TciError, match="which has its own"):
        tci.PolicyCapability(WITHDRAW, spec)
