"""Coverage of a receptive field in the present posture. The skin of iCub's forearm turns with pronation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.fields import default_fields
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import JointReading, Landmark, LimbPlace, Perception, Reading, SkinFrame
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import joint_map
from tci.robot.limb import generic_limb_distance
from tci.testing import TouchedRobot, perception

ROBOT = load_robot("icub")
BODY = GenericBody(ROBOT)
PATCH = next(patch for patch in ROBOT.patches if (patch.part, patch.segment) == ("left_arm", "forearm"))
FIELD = next(field for field in default_fields() if field.name == "forearm_extensor")


def turned(pronation: float) -> Array:
    """Returns angles (n_servos,) [rad] with the left forearm turned by `pronation` [deg]."""
    rest = np.zeros(len(ROBOT.servos))
    arm, position = joint_map(ROBOT, "left_arm"), rest.copy()
    position[arm.servos] = arm.to_robot(np.deg2rad([25.0, 25.0, 0.0, 60.0, pronation]), rest)
    return position


class Feeling:
    """A body whose forearm taxels have noise. The noise of the taxels `spoilt` is much larger."""

    def __init__(self, spoilt: np.ndarray) -> None:
        self.perceiver, self.tick, self.random = Perceiver(BODY), 0, np.random.default_rng(3)
        self.spoilt = spoilt

    def perceive(self, pronation: float) -> Perception:
        """Returns the perception of one frame, 0.1 s after the previous one."""
        self.tick += 1
        values = np.rint(PATCH.sensor.rest + self.random.standard_normal(PATCH.channels))
        values[BODY.skin.surfaces[PATCH.name].channels[self.spoilt]] += 60.0 * self.random.standard_normal(
            len(self.spoilt)
        )
        position, now = turned(pronation), 0.1 * self.tick
        octets = np.clip(values, PATCH.sensor.lowest, PATCH.sensor.highest).astype(np.uint8)
        frame = SkinFrame(PATCH.name, now, self.tick, octets)
        joints = JointReading(now, self.tick, position, np.zeros_like(position))
        return self.perceiver.step(Reading(joints, (frame,)), now)


def inside(pronation: float) -> np.ndarray:
    """Returns a mask (n,) of the forearm's taxels that lie in the field."""
    position = turned(pronation)
    u, theta, _ = BODY.skin.limb(PATCH.name, JointReading(0.0, 0, position, np.zeros_like(position)))
    here: np.ndarray = generic_limb_distance(u, theta, FIELD.u, FIELD.theta) < FIELD.radius
    return here


def share(seen: Perception) -> float:
    place = LimbPlace(PATCH.segment, FIELD.u, FIELD.theta)
    return float(BODY.coverage(seen, PATCH.part, [place], np.array([FIELD.radius]))[0])


def test_it_is_told_for_where_the_arm_is_now() -> None:
    reflex, gone = WithdrawalReflex(), inside(60.0) & ~inside(-60.0)
    assert gone.sum() > 20
    feeling = Feeling(np.flatnonzero(gone))
    for _ in range(902):
        seen = feeling.perceive(-60.0)
    assert share(seen) == 1.0
    assert "forearm_extensor" not in str(reflex.fault(seen, BODY))
    for pronation in (60.0, 0.0, -60.0, 59.0):
        seen = feeling.perceive(pronation)
        field = inside(pronation)
        assert share(seen) == pytest.approx(1.0 - gone[field].mean())
    assert share(seen) < 0.5
    assert "forearm_extensor of left_arm is blind" in str(reflex.fault(seen, BODY))


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_shares_of_all_fields_are_those_of_numpy(name: str) -> None:
    touched, random = TouchedRobot(name), np.random.default_rng(0)
    body, fields, seen = touched.body, default_fields(), touched.perceive()
    places = [LimbPlace(field.segment, field.u, field.theta) for field in fields]
    patches = {patch.name: body.skin.surfaces[patch.name].positions for patch in body.robot.patches}
    masked = random.random(sum(map(len, patches.values()))) < 0.4
    assert seen.skin is not None
    assert seen.joints is not None
    seen = replace(seen, skin=replace(seen.skin, masked=masked))
    own = dict(
        zip(patches, np.split(masked, np.cumsum([len(p) for p in patches.values()])[:-1]), strict=True)
    )
    for part in body.parts("arm"):
        found = body.coverage(seen, part, places, np.array([field.radius for field in fields]))
        for field, share in zip(fields, found, strict=True):
            near = []
            for patch in body.robot.patches:
                if (patch.part, patch.segment) == (part, field.segment):
                    u, theta, _ = body.skin.limb(patch.name, seen.joints)
                    inside = generic_limb_distance(u, theta, field.u, field.theta) < field.radius
                    near.append(own[patch.name][inside])
            assert share == pytest.approx(1.0 - np.concatenate(near).mean())


def test_a_landmark_is_covered_by_the_skin_around_it() -> None:
    robot = load_robot("nao-whole")
    body, landmark = GenericBody(robot), Landmark("", (1.0, 0.0, 0.0))
    seen = perception(robot)
    assert seen.skin is not None
    assert seen.skin.masked is None
    assert body.coverage(seen, "head", [landmark], np.array([0.03])).tolist() == [1.0]
    sizes = [len(body.skin.surfaces[patch.name].positions) for patch in robot.patches]
    begins = dict(zip([patch.name for patch in robot.patches], np.cumsum([0, *sizes]).tolist(), strict=False))
    place, surface = body.landmark("head", landmark), body.skin.surfaces["head_skin"]
    near = np.flatnonzero(np.linalg.norm(surface.positions - place.p_L, axis=1) < 0.02)
    masked = np.zeros(sum(sizes), dtype=bool)
    masked[begins["head_skin"] + near] = True
    blind = replace(seen, skin=replace(seen.skin, masked=masked))
    shares = body.coverage(blind, "head", [landmark] * 3, np.array([0.015, 0.04, 1e-6]))
    assert shares[0] == 0.0
    assert 0.0 < shares[1] < 1.0
    assert shares[2] == 1.0, "no taxel is that near"
    assert body.coverage(blind, "head", [Landmark("tail", (1.0, 0.0, 0.0))], np.array([1.0])).tolist() == [
        1.0
    ]


def test_it_is_known_only_while_a_taxel_is_masked() -> None:
    feeling = Feeling(np.zeros(0, dtype=int))
    seen = [feeling.perceive(10.0 * tick) for tick in range(5)]
    assert all(one.skin is not None and one.skin.masked is None for one in seen)
    assert share(seen[-1]) == 1.0
