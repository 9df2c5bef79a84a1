"""Rules of the whole-body withdrawal, without a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from helpers.touches import BODY, away, body_that, touch
from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyMemory, BodyWithdrawal
from tci.capabilities.fields import BODY_JOINTS, BodyFields, default_body_fields, load_body_fields
from tci.errors import DescriptionError, TciError
from tci.messages import Contact, Contacts, GenericCommand, Landmark, Perception, Support
from tci.messages.frames import Array
from tci.testing import TouchedRobot

POSTURE = {"head": np.zeros(3), "torso": np.zeros(3), "left_leg": np.zeros(6), "left_arm": np.zeros(5)}
FACE = default_body_fields().field[0]
SHIN = next(field for field in default_body_fields().field if field.name == "shank_front")


def see(
    *contacts: Contact, stamp: float = 0.0, at: Landmark = FACE.landmark, distance: float = 0.0,
    joints: Mapping[str, Array] | None = None, posture: Mapping[str, Array] = POSTURE,
) -> tuple[Perception, GenericBody]:  # fmt: skip
    """Returns the perception of contacts at `distance` [m] from one landmark and far from all others, and a
    body with all joints or only some."""
    body = body_that(
        "nao-whole",
        retreat=away,
        distances=lambda contact, landmarks: [distance if one == at else np.inf for one in landmarks],
        support=lambda perception, leg, target: Support({}, -np.inf),
        has_joint=lambda part: (joints or {}).get(part, np.ones(len(POSTURE[part]), bool)),
    )
    return Perception(stamp, posture, Contacts.of(contacts)), body


def press(part: str, force: float, *, segment: str = "", sequence: int = 0) -> Contact:
    return touch(np.nan, np.nan, [force], part=part, segment=segment, sequence=sequence)


def step(
    reflex: BodyWithdrawal, view: tuple[Perception, GenericBody], memory: BodyMemory | None = None
) -> tuple[list[GenericCommand], BodyMemory]:
    orders, after = reflex.step(memory or reflex.init(BODY), *view)
    commands = [order for order in orders if isinstance(order, GenericCommand)]
    assert len(commands) == len(orders)
    return commands, after


def test_gain_is_that_of_equation_5() -> None:
    reflex = BodyWithdrawal(response="meant")
    force = reflex.fields.force
    middle = (force.threshold_n + force.saturation_n) / 2.0
    for pressed, distance, gain in (
        (force.saturation_n, 0.0, 1.0),
        (10.0, 0.0, 1.0),
        (middle, 0.0, 0.5),
        (10.0, FACE.radius_m / 2.0, 0.5),
        (middle, FACE.radius_m / 2.0, 0.25),
    ):
        commands, _ = step(reflex, see(press("head", pressed), distance=distance))
        assert [command.part for command in commands] == ["head"]
        np.testing.assert_allclose(commands[0].values, gain * np.array(FACE.motion), atol=1e-12)
    for pressed, distance in ((force.threshold_n, 0.0), (10.0, FACE.radius_m), (np.nan, 0.0), (10.0, np.inf)):
        assert not step(reflex, see(press("head", pressed), distance=distance))[0]


def test_one_touch_is_answered_once() -> None:
    reflex = BodyWithdrawal(response="meant")
    commands, memory = step(reflex, see(press("head", 1.0), stamp=0.0))
    assert len(commands) == 1
    assert list(memory) == ["head"]
    again, memory = step(reflex, see(press("head", 1.0), stamp=0.1), memory)
    assert not again
    harder, memory = step(reflex, see(press("head", 5.0), stamp=0.2), memory)
    # counted from the posture at the start of the withdrawal
    np.testing.assert_allclose(harder[0].values, FACE.motion, atol=1e-12)
    nothing, memory = step(reflex, see(stamp=0.3), memory)
    assert not nothing
    assert list(memory) == ["head"]
    _, memory = step(reflex, see(stamp=0.9), memory)
    assert not memory
    assert step(reflex, see(press("head", 1.0), stamp=1.0), memory)[0]


@pytest.mark.parametrize(("refractory", "period"), [(0.5, 0.6), (0.005, 0.01)])
def test_a_lasting_touch_is_answered_once_however_rarely_it_is_seen(refractory: float, period: float) -> None:
    reflex = BodyWithdrawal(refractory=refractory, response="meant")
    memory, moments = reflex.init(BODY), []
    for tick in range(20):
        posture = POSTURE | {"head": np.full(3, 0.1 * tick)}
        seen = see(press("head", 5.0), stamp=period * tick, posture=posture)
        commands, memory = step(reflex, seen, memory)
        moments += [tick for _ in commands]
    assert moments == [0]
    assert memory["head"].touched == period * 19
    # counted from the posture at the start of the touch
    np.testing.assert_allclose(memory["head"].target, FACE.motion)


def test_a_withdrawal_in_the_place_of_one_that_is_over_is_sent() -> None:
    reflex = BodyWithdrawal(response="meant")
    _, memory = step(reflex, see(press("head", 5.0), stamp=0.0))
    nothing, memory = step(reflex, see(stamp=0.3), memory)
    assert not nothing
    elsewhere = see(press("head", 5.0), stamp=0.6, posture=POSTURE | {"head": np.full(3, 0.1)})
    again, memory = step(reflex, elsewhere, memory)
    np.testing.assert_allclose(again[0].values, 0.1 + np.array(FACE.motion), atol=1e-12)
    assert memory["head"].started == 0.6


def test_a_touch_that_a_leg_has_answered_is_not_answered_again_after_a_refusal() -> None:
    reflex = BodyWithdrawal(stance="supported", response="meant")
    shank, sole = press("left_leg", 5.0, segment="shank"), press("right_leg", 20.0, segment="foot")
    memory, moments = reflex.init(BODY), []
    for tick in range(100):
        stands = 10 <= tick < 60
        contacts = (shank, sole) if stands else (shank,)
        posture = POSTURE | {"left_leg": np.full(6, 0.01 * tick)}
        seen = see(*contacts, stamp=0.02 * tick, at=SHIN.landmark, posture=posture)
        commands, memory = step(reflex, seen, memory)
        moments += [tick for _ in commands]
        assert ("left_leg" in memory.refused) == stands
    assert moments == [0]


def test_a_leg_that_may_move_again_goes_as_far_as_the_touch_asks_for() -> None:
    reflex = BodyWithdrawal(stance="supported", response="meant")
    light, hard = (press("left_leg", force, segment="shank") for force in (0.5, 5.0))
    sole = press("right_leg", 20.0, segment="foot")
    first, memory = step(reflex, see(light, stamp=0.0, at=SHIN.landmark))
    refused, memory = step(reflex, see(hard, sole, stamp=0.1, at=SHIN.landmark), memory)
    assert not refused
    assert memory["left_leg"].gain == pytest.approx(first[0].values.sum() / np.sum(SHIN.motion))
    freed, _ = step(reflex, see(hard, stamp=0.2, at=SHIN.landmark), memory)
    np.testing.assert_allclose(freed[0].values, SHIN.motion, atol=1e-12)


def test_a_standing_robot_keeps_its_legs_and_says_why() -> None:
    shin = see(press("left_leg", 5.0, segment="shank"), at=SHIN.landmark)
    commands, memory = step(BodyWithdrawal(response="meant"), shin)
    assert not commands
    assert "stands" in memory.refused["left_leg"].reason
    assert BodyWithdrawal(response="meant").notes(memory) == (
        f"left_leg was touched and does not move: {memory.refused['left_leg'].reason}",
    )
    commands, memory = step(BodyWithdrawal(stance="supported", response="meant"), shin)
    assert [command.part for command in commands] == ["left_leg"]
    assert not memory.refused


def test_weight_under_a_sole_is_believed_before_anybody() -> None:
    reflex = BodyWithdrawal(stance="supported", response="meant")
    shank = press("left_leg", 5.0, segment="shank")
    sole = press("right_leg", 20.0, segment="foot")
    commands, memory = step(reflex, see(shank, sole, at=SHIN.landmark))
    assert not commands
    assert "20.0 N: right_leg carries the robot" in memory.refused["left_leg"].reason
    light = press("right_leg", 2.0, segment="foot")
    assert step(reflex, see(shank, light, at=SHIN.landmark))[0]


def test_other_parts_answer_while_the_legs_carry() -> None:
    reflex = BodyWithdrawal(response="meant")
    commands, _ = step(reflex, see(press("head", 5.0), press("right_leg", 50.0, segment="foot")))
    assert [command.part for command in commands] == ["head"]


def test_a_part_without_the_joint_does_not_answer() -> None:
    head = see(press("head", 5.0), joints={"head": np.array([False, True, True])})
    assert not step(BodyWithdrawal(response="meant"), head)[0]
    head = see(press("head", 5.0), joints={"head": np.array([True, False, False])})
    assert step(BodyWithdrawal(response="meant"), head)[0]


def test_arms_are_left_to_their_own_reflex() -> None:
    assert not step(BodyWithdrawal(response="meant"), see(press("left_arm", 5.0, segment="forearm")))[0]


def test_the_order_of_contacts_plays_no_part() -> None:
    one, other = press("head", 1.0, sequence=1), press("head", 3.0, sequence=1)
    first, _ = step(BodyWithdrawal(response="meant"), see(one, other))
    second, _ = step(BodyWithdrawal(response="meant"), see(other, one))
    np.testing.assert_array_equal(first[0].values, second[0].values)


def test_settings_that_make_no_sense_are_refused() -> None:
    for change in ({"refractory": 0.0}, {"weight": np.inf}, {"stance": "floating"}):
        with pytest.raises(TciError, match="valid"):
            replace(BodyWithdrawal(response="meant"), **change)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("nonsense", "is not TOML"),
        ("[force]\nthreshold_n = 1\nsaturation_n = 0.5\n", "must be above threshold"),
        ("[force]\nthreshold_n = 1\nsaturation_n = 2\n", "field: Field required"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "fields.toml").write_text(text)
    with pytest.raises(DescriptionError, match=told):
        load_body_fields(tmp_path / "fields.toml")


def test_all_faults_of_a_field_are_told(tmp_path: Path) -> None:
    (tmp_path / "f.toml").write_text(
        "[force]\nthreshold_n = 0.1\nsaturation_n = 1\n"
        '[[field]]\nname = "Nose"\nkind = "tail"\ntowards = [1, 0]\nradius_m = 0\nsize = 1\n'
        "motion_deg = { wag = 10 }\n"
    )
    with pytest.raises(DescriptionError) as caught:
        load_body_fields(tmp_path / "f.toml")
    message = str(caught.value)
    for key in ("name", "kind", "towards", "radius_m"):
        assert f"field 1 (Nose), {key}" in message
    assert "field 1 (Nose), size: unknown key; valid: name, kind, segment, motion_deg, towards" in message


def test_a_joint_that_the_kind_lacks_is_refused() -> None:
    field = FACE.model_dump() | {"motion_deg": {"knee_pitch": 5.0}}
    with pytest.raises(ValueError, match="which a head lacks; valid: pitch, roll, yaw"):
        BodyFields.model_validate({"force": {"threshold_n": 0.1, "saturation_n": 1.0}, "field": [field]})


def test_each_motion_has_an_angle_for_each_joint() -> None:
    for field in default_body_fields().field:
        assert len(field.motion) == len(BODY_JOINTS[field.kind])
        assert np.abs(field.motion).max() <= np.deg2rad(30.0)


@pytest.mark.parametrize(
    ("name", "patches"),
    [("nao-whole", ("head_skin", "left_shank", "left_thigh")), ("icub-whole", ("head_skin", "left_palm"))],
)
def test_every_place_is_answered_alike_or_a_reason_is_told(name: str, patches: tuple[str, ...]) -> None:
    """By the blend; of the nearest fields half of the skin has none."""
    touched, reflex = TouchedRobot(name), BodyWithdrawal(stance="supported")
    for patch in patches:
        at = touched.body.skin.surfaces[patch].positions
        part, commands, refused = touched.robot.patch(patch).part, {}, 0
        for taxel in range(len(at)):
            seen = touched.perceive(patch, taxel=taxel, force=5.0)
            orders, memory = reflex.step(reflex.init(touched.body), seen, touched.body)
            for order in orders:
                assert isinstance(order, GenericCommand)
                commands[taxel] = np.rad2deg(order.values - seen.posture[part])
            refused += not orders
            assert orders or reflex.notes(memory) or not len(seen.contacts)
        sizes = [float(np.abs(one).max()) for one in commands.values()]
        apart = np.linalg.norm(at[:, None] - at[None], axis=-1) <= 0.013
        near = [np.abs(a - b).max() for i, a in commands.items() for j, b in commands.items() if apart[i, j]]
        print(patch, len(commands), refused, min(sizes), np.median(sizes), max(near))
        assert min(sizes) >= 0.5 * np.median(sizes)
        assert max(near) < 7.0


def test_the_printed_equation_is_largest_at_the_edge() -> None:
    reflex = BodyWithdrawal(response="printed")
    sizes = []
    for share in (0.0, 0.5, 0.9):
        commands, _ = step(reflex, see(press("head", 5.0), distance=share * FACE.radius_m))
        sizes.append(np.abs(commands[0].values).max() if commands else 0.0)
    np.testing.assert_allclose(sizes, np.array([0.0, 0.5, 0.9]) * np.abs(FACE.motion).max(), atol=1e-12)
