"""The nine properties that a force-distance reflex must have, by number. Also tests that steps have no side
effects."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.touches import BODY, BOTH_ARMS, POSTURE, one_field, poke, see, touch
from tci.body.posture import to_platform
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.capabilities.withdrawal import Response, WithdrawalMemory, WithdrawalReflex
from tci.capabilities.withdrawal_memory import Withdrawal
from tci.errors import CommandError, TciError
from tci.gate.gate import Gate
from tci.messages import Contact, JointReading, Mode, Perception
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import generic_posture
from tci.robot.limb import generic_limb_distance

FIELD = one_field()
REFLEX = WithdrawalReflex(response="meant", fields=(FIELD,))
THETA = np.array(FIELD.motion)

forces = st.floats(0.0, 20.0)
places = st.tuples(st.floats(-0.2, 1.2), st.floats(-np.pi, np.pi))
contacts = st.builds(
    lambda place, taxels, part, segment: touch(
        *place, [f for f, _ in taxels], offsets=[o for _, o in taxels], part=part, segment=segment
    ),
    places,
    st.lists(st.tuples(forces, st.floats(-0.3, 0.3)), max_size=6),
    st.sampled_from(["left_arm", "right_arm"]),
    st.sampled_from(["forearm", "upper_arm"]),
)


def motion(reflex: WithdrawalReflex, *touches: Contact, part: str = "left_arm") -> Array:
    """Returns the motion (5,) [rad] of an arm at rest, in generic joints, in response to the touches."""
    commands, _ = reflex.step(reflex.init(BODY), see(*touches), BODY)
    target = {command.part: command.values for command in commands}.get(part, POSTURE)
    return np.asarray(target - POSTURE)


def gain_of(reflex: WithdrawalReflex, contact: Contact) -> float:
    answer = reflex.answer(contact)
    return 0.0 if answer is None else answer.gain


def play(reflex: WithdrawalReflex, *frames: Perception) -> list[tuple[str, Array]]:
    """Returns all commands as (part, target) over successive frames."""
    memory, seen = reflex.init(BODY), []
    for frame in frames:
        commands, memory = reflex.step(memory, frame, BODY)
        seen += [(command.part, command.values) for command in commands]
    return seen


@given(places, forces)
def test_1_nothing_at_or_beyond_the_edge_nor_up_to_the_threshold(
    place: tuple[float, float], force: float
) -> None:
    distance = float(generic_limb_distance(*place, FIELD.u, FIELD.theta))
    moves = bool(motion(REFLEX, touch(*place, [force])).any())
    if distance >= FIELD.radius or force <= FIELD.threshold:
        assert not moves
    elif distance < 0.999 * FIELD.radius and force > 1.001 * FIELD.threshold:
        assert moves


@given(offsets=st.lists(st.floats(0.0, 0.4), min_size=2, max_size=2))
def test_2_largest_at_the_centre_and_never_rising_outwards(offsets: list[float]) -> None:
    reflex = WithdrawalReflex(response="meant", fields=(FIELD,))
    near, far = (gain_of(reflex, touch(FIELD.u + offset, 0.0, [5.0])) for offset in sorted(offsets))
    assert far <= near <= gain_of(reflex, poke(FIELD, 5.0)) == 1.0


def test_2_continuous_to_nothing_at_the_edge() -> None:
    reflex = WithdrawalReflex(response="meant", fields=(FIELD,))
    steps = np.linspace(0.0, 1.2 * FIELD.radius, 241)
    gains = [gain_of(reflex, touch(FIELD.u + step, 0.0, [5.0])) for step in steps]
    assert max(abs(b - a) for a, b in pairwise(gains)) <= 0.01
    assert gains[-1] == 0.0


@given(places, forces, forces)
def test_3_never_falling_with_force_and_bounded(place: tuple[float, float], a: float, b: float) -> None:
    weak, strong = (np.abs(motion(REFLEX, touch(*place, [force]))) for force in sorted((a, b)))
    assert np.all(weak <= strong + 1e-12)
    assert np.all(strong <= np.abs(THETA) + 1e-12)


def test_3_saturates_at_the_base_motion() -> None:
    for force in (FIELD.saturation, 2.0 * FIELD.saturation, 1e6):
        np.testing.assert_allclose(motion(REFLEX, poke(FIELD, force)), THETA, atol=1e-15)


@given(places, forces)
def test_4_one_gain_for_all_joints(place: tuple[float, float], force: float) -> None:
    contact = touch(*place, [force])
    expected = gain_of(REFLEX, contact) * THETA
    np.testing.assert_allclose(motion(REFLEX, contact), expected, atol=1e-12)


@given(
    st.lists(st.tuples(forces, st.floats(-0.3, 0.3)), min_size=1, max_size=8).flatmap(
        lambda taxels: st.tuples(st.just(taxels), st.permutations(taxels))
    )
)
def test_5_the_order_of_taxels_plays_no_part(
    orders: tuple[list[tuple[float, float]], list[tuple[float, float]]],
) -> None:
    one, other = (
        gain_of(REFLEX, touch(0.5, 0.1, [f for f, _ in taxels], offsets=[o for _, o in taxels]))
        for taxels in orders
    )
    assert one == pytest.approx(other, abs=1e-12)


@given(st.lists(contacts, max_size=4))
def test_5_nor_does_the_order_of_contacts(touches: list[Contact]) -> None:
    reflex = WithdrawalReflex()
    for order in permutations(touches):
        for part in BOTH_ARMS:
            expected = motion(reflex, *touches, part=part)
            assert np.array_equal(motion(reflex, *order, part=part), expected)


def test_5_not_even_where_two_contacts_ask_for_the_same_gain() -> None:
    twins = [poke(FIELD, 5.0), poke(one_field(theta=np.pi), 5.0)]
    reflex = WithdrawalReflex(
        response="meant", fields=(FIELD, one_field(name="twin", theta=np.pi, motion=(-0.3, 0, 0, 0, 0)))
    )
    assert np.array_equal(motion(reflex, *twins), motion(reflex, *reversed(twins)))


overlapping = st.lists(
    st.builds(
        lambda u, theta, angle: {"u": u, "theta": theta, "motion": (angle, 0.0, 0.0, 0.1, 0.0)},
        st.floats(0.3, 0.7),
        st.floats(-1.0, 1.0),
        st.floats(-1.0, 1.0),
    ),
    min_size=1,
    max_size=6,
)


@given(overlapping, places, st.floats(0.0, 10.0))
def test_6_of_overlapping_fields_the_closest_wins_alone(
    words: list[dict[str, object]], place: tuple[float, float], force: float
) -> None:
    fields = [one_field(name=f"field{index}", radius=0.6, **word) for index, word in enumerate(words)]
    answer = WithdrawalReflex(response="meant", fields=fields).answer(touch(*place, [force]))
    distances = [float(generic_limb_distance(*place, field.u, field.theta)) for field in fields]
    closest = fields[int(np.argmin(distances))]
    if answer is None:
        assert min(distances) >= 0.6 * 0.999 or force <= FIELD.threshold * 1.001
    else:
        assert answer.name == closest.name
        assert answer == WithdrawalReflex(response="meant", fields=(closest,)).answer(touch(*place, [force]))


def test_6_a_field_that_ends_before_the_touch_does_not_shadow_one_that_reaches_it() -> None:
    narrow, wide = one_field(name="narrow", radius=0.1), one_field(name="wide", u=0.8)
    answer = WithdrawalReflex(response="meant", fields=(narrow, wide)).answer(touch(0.604, 0.0, [5.0]))
    assert answer is not None
    assert answer.name == "wide"


def test_6_many_contacts_do_not_add_up() -> None:
    touches = [touch(0.5, 0.01 * index, [5.0], sequence=index) for index in range(20)]
    assert np.all(np.abs(motion(REFLEX, *touches)) <= np.abs(THETA) + 1e-12)
    strongest = max(gain_of(REFLEX, contact) for contact in touches)
    np.testing.assert_allclose(motion(REFLEX, *touches), strongest * THETA, atol=1e-12)


NAO = load_robot("nao")
LEFT_LIMITS = np.deg2rad([[-29.5, 209.5], [-18, 76], [-29.5, 209.5], [2, 88.5], [-104.5, 104.5]])


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5), st.sampled_from(default_fields()), st.booleans()
)
def test_7_the_gate_keeps_posture_plus_motion_within_the_limits(
    shares: list[float], field: ReceptiveField, left: bool
) -> None:
    """The posture may be at its limits. The gate limits the target, because the reflex has no data about the
    robot's limits."""
    part = "left_arm" if left else "right_arm"
    start = LEFT_LIMITS[:, 0] + np.array(shares) * np.ptp(LEFT_LIMITS, axis=1)
    position = np.zeros(len(NAO.servos))
    for servo, angle in zip(NAO.part(part).servos, start, strict=True):
        assert servo.servo is not None
        position[servo.servo] = (angle - servo.offset) / servo.scale
    joints = JointReading(0.0, 0, position, np.zeros(len(position)))
    reflex = WithdrawalReflex()
    commands, _ = reflex.step(
        reflex.init(BODY), see(poke(field, 10.0, part=part), posture=generic_posture(NAO, joints)), BODY
    )
    assert [command.part for command in commands] == [part]
    gate = Gate(NAO, period=0.02, stale_after=10.0)
    platform = [to_platform(NAO, command) for command in commands]
    for tick in range(40):
        safe = gate.step(platform if tick == 0 else [], joints, 0.02 * tick)
        for index, angle in zip(safe.servos, safe.position, strict=True):
            limits = NAO.servos[index].limits
            assert limits.lower is not None
            assert limits.upper is not None
            assert limits.lower - 1e-9 <= angle <= limits.upper + 1e-9


@pytest.mark.parametrize(
    "contact",
    [
        touch(0.5, 0.0, []),
        touch(0.5, 0.0, [0.0, 0.0]),
        touch(0.5, 0.0, [np.nan]),
        touch(0.5, 0.0, [np.nan, 5.0]),
        touch(np.nan, 0.0, [5.0]),
        touch(0.5, np.nan, [5.0]),
        touch(np.nan, np.nan, [np.nan]),
    ],
    ids=["no taxel", "no force", "NaN force", "one NaN of two", "NaN u", "NaN theta", "all NaN"],
)
@pytest.mark.parametrize("measure", ["total", "weighted", "peak"])
def test_8_no_response_without_a_force_at_a_place(contact: Contact, measure: str) -> None:
    reflex = WithdrawalReflex(response="meant", fields=(one_field(measure=measure),))
    commands, memory = reflex.step(reflex.init(BODY), see(contact), BODY)
    assert commands == ()
    assert not memory


def test_8_no_contact_no_response() -> None:
    assert play(REFLEX, *(see(stamp=0.01 * tick) for tick in range(5))) == []


def test_8_no_response_from_a_posture_that_is_not_known() -> None:
    unknown = {"left_arm": np.array([0.0, np.nan, 0.0, 0.0, 0.0])}
    assert play(REFLEX, see(poke(FIELD, 5.0), posture=unknown)) == []


OTHER = one_field(name="other", theta=np.pi, motion=(-0.3, 0.2, 0.0, -0.4, -0.1))
TWO = WithdrawalReflex(response="meant", fields=(FIELD, OTHER), refractory=0.5)


def test_9_a_lasting_touch_is_answered_once() -> None:
    frames = [see(poke(FIELD, 5.0, sequence=tick), stamp=0.01 * tick) for tick in range(300)]
    assert len(play(TWO, *frames)) == 1


def test_9_what_the_motion_itself_touches_is_not_answered() -> None:
    """The arm repeatedly withdraws into an object on the opposite side."""
    frames = [see(poke(FIELD, 5.0), stamp=0.0)]
    frames += [see(poke(OTHER, 5.0, sequence=tick), stamp=0.01 * tick) for tick in range(1, 300)]
    assert len(play(TWO, *frames)) == 1


def test_9_a_new_touch_is_answered_after_the_refractory_period_from_where_the_arm_is() -> None:
    later = {"left_arm": POSTURE + 0.3}
    seen = play(
        TWO,
        see(poke(FIELD, 5.0), stamp=0.0),
        see(stamp=0.1),
        see(poke(OTHER, 5.0), stamp=0.49, posture=later),
        see(stamp=0.98, posture=later),
        see(poke(OTHER, 5.0), stamp=0.99, posture=later),
    )
    assert len(seen) == 2
    np.testing.assert_array_equal(seen[1][1], later["left_arm"] + np.array(OTHER.motion))


@pytest.mark.parametrize(("refractory", "period"), [(0.5, 0.6), (0.005, 0.01)])
def test_9_a_lasting_touch_is_answered_once_however_rarely_it_is_seen(
    refractory: float, period: float
) -> None:
    reflex = WithdrawalReflex(response="meant", fields=(FIELD,), refractory=refractory)
    frames = [
        see(poke(FIELD, 5.0, sequence=tick), stamp=period * tick, posture={"left_arm": POSTURE + 0.1 * tick})
        for tick in range(20)
    ]
    assert len(play(reflex, *frames)) == 1
    gone = see(stamp=period * 20)
    new = see(poke(FIELD, 5.0, sequence=21), stamp=period * 21)
    assert len(play(reflex, *frames, gone, new)) == 2


def test_9_a_touch_after_the_refractory_period_of_quiet_is_new_though_no_step_came_in_between() -> None:
    touched = see(poke(FIELD, 5.0), stamp=0.0)
    assert len(play(TWO, touched, see(stamp=0.1), see(poke(FIELD, 5.0), stamp=0.49))) == 1
    assert len(play(TWO, touched, see(stamp=0.1), see(poke(FIELD, 5.0), stamp=0.5))) == 2


@given(st.lists(st.tuples(forces, st.sampled_from([FIELD, OTHER])), min_size=1, max_size=12))
def test_9_the_gain_may_grow_with_the_touch_but_never_beyond_the_base_motion(
    course: list[tuple[float, ReceptiveField]],
) -> None:
    """During one touch, the targets move outwards on a straight line that starts at the posture at the
    touch's beginning."""
    frames = [
        see(poke(field, force), stamp=0.01 * tick, posture={"left_arm": POSTURE + 0.001 * tick})
        for tick, (force, field) in enumerate(course)
    ]
    loud = [tick for tick, (force, _) in enumerate(course) if force > FIELD.threshold]
    seen = play(TWO, *frames)
    if not loud:
        assert seen == []
        return
    first = course[loud[0]][1]
    origin = POSTURE + 0.001 * loud[0]
    gains = [(target - origin)[0] / first.motion[0] for _, target in seen]
    assert gains == sorted(gains)
    best = max(force for force, field in course if field is first)
    assert gains[-1] == pytest.approx(min((best - 1.0) / 2.0, 1.0), abs=1e-9)
    for (_, target), gain in zip(seen, gains, strict=True):
        np.testing.assert_allclose(target - origin, gain * np.array(first.motion), atol=1e-12)


def test_the_same_frame_seen_again_changes_nothing() -> None:
    frames = [see(poke(FIELD, 2.0), stamp=0.002 * tick, posture=BOTH_ARMS) for tick in range(10)]
    assert len(play(REFLEX, *frames)) == 1


def test_a_command_is_the_posture_at_the_trigger_plus_the_gain_times_the_base_motion() -> None:
    ((command,), memory) = REFLEX.step(REFLEX.init(BODY), see(poke(FIELD, 2.0), stamp=3.0), BODY)
    assert (command.part, command.mode) == ("left_arm", Mode.POSITION)
    np.testing.assert_allclose(command.values, POSTURE + 0.5 * THETA, atol=1e-15)
    assert not command.values.flags.writeable
    held = memory["left_arm"]
    assert (held.field.name, held.gain, held.started, held.touched) == (FIELD.name, 0.5, 3.0, 3.0)


def test_the_weighted_force_is_that_of_eq_7() -> None:
    """Two taxels at a distance of 0.3 in u, with r = 0.3, have the weights 2 r - d = 0.6 and 0.3."""
    contact = touch(0.5, 0.0, [2.5, 1.0], offsets=[0.0, 0.3])
    reflex = WithdrawalReflex(response="meant", fields=(one_field(measure="weighted"),))
    assert gain_of(reflex, contact) == pytest.approx((2.0 - 1.0) / 2.0)
    assert gain_of(REFLEX, contact) == 1.0
    assert gain_of(
        WithdrawalReflex(response="meant", fields=(one_field(measure="peak"),)), contact
    ) == pytest.approx(0.75)


@given(st.lists(contacts, max_size=4), st.lists(contacts, max_size=4))
def test_two_arms_are_independent(one: list[Contact], other: list[Contact]) -> None:
    reflex = WithdrawalReflex()
    frames = [see(*one, stamp=0.0), see(*other, stamp=0.01)]
    for part in BOTH_ARMS:
        alone = [
            see(*(c for c in frame.contacts if c.part == part), stamp=frame.stamp, posture={part: POSTURE})
            for frame in frames
        ]
        together = [target for name, target in play(reflex, *frames) if name == part]
        separate = [target for _, target in play(reflex, *alone)]
        assert len(together) == len(separate)
        for a, b in zip(together, separate, strict=True):
            assert np.array_equal(a, b)


def bits(memory: WithdrawalMemory) -> dict[str, tuple[object, ...]]:
    def one(w: Withdrawal[Response]) -> tuple[object, ...]:
        return w.field, w.origin.tobytes(), w.gain, w.started, w.touched

    return {part: one(withdrawal) for part, withdrawal in memory.items()}


@given(st.lists(st.lists(contacts, max_size=3), min_size=1, max_size=5))
def test_the_same_inputs_give_the_same_outputs_bit_for_bit(course: list[list[Contact]]) -> None:
    """The outputs are also equal for a new object with equal settings, and from a stored memory. Each skin
    frame lasts for several steps, as on a robot."""
    reflex = WithdrawalReflex()
    memory = reflex.init(BODY)
    frames = [see(*touches) for touches in course for _ in range(2)]
    for tick, frame in enumerate(frame for frame in frames for _ in range(3)):
        perception = replace(frame, stamp=0.05 * tick)
        before = bits(memory)
        commands, after = reflex.step(memory, perception, BODY)
        again, after_again = WithdrawalReflex().step(pickle.loads(pickle.dumps(memory)), perception, BODY)
        assert bits(memory) == before
        assert bits(after) == bits(after_again)
        assert [(c.part, c.values.tobytes()) for c in commands] == [
            (c.part, c.values.tobytes()) for c in again
        ]
        memory = after


def test_without_fields_nothing_moves() -> None:
    assert play(WithdrawalReflex(response="meant", fields=()), see(poke(FIELD, 5.0))) == []


def test_a_contact_of_another_segment_or_part_is_not_answered() -> None:
    wrong = [touch(0.5, 0.0, [5.0], segment="upper_arm"), touch(0.5, 0.0, [5.0], part="left_leg")]
    assert play(REFLEX, see(*wrong)) == []


def test_wrong_settings_are_refused() -> None:
    for refractory in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(TciError, match="withdrawal: refractory"):
            WithdrawalReflex(refractory=refractory)
    with pytest.raises(TciError, match="valid: blended, meant, printed"):
        WithdrawalReflex(response="square")
    for people in (5, None, ["chest"]):
        with pytest.raises(TciError, match=r"withdrawal: people .*; valid: a sequence of tci\.body\.Struck"):
            WithdrawalReflex(people=people)  # type: ignore[arg-type]


def test_a_part_that_is_no_generic_arm_is_refused() -> None:
    with pytest.raises(CommandError, match="left_arm has 4 generic joints; valid: 5"):
        REFLEX.step(REFLEX.init(BODY), see(poke(FIELD, 5.0), posture={"left_arm": np.zeros(4)}), BODY)
