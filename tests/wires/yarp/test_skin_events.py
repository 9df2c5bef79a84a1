"""Contacts in skinManager's form: iDyn's frames, and numbers of the port's values. The oracle knows iKin's
published parameters and nothing of TCI's transforms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tci
from helpers.skin_data import SkinData
from tci.body.perceiver import Perceiver
from tci.messages import Contacts, JointReading, Reading, SkinFrame
from tci.messages.frames import Array
from tci.robot.kinematics import KinematicChain
from tci.skin.skin import Skin
from tci.wires.yarp.skin_events import EventForm, decode_events

ICUB = tci.load_robot("icub")
BODY = tci.GenericBody(ICUB)
EXCHANGE = json.loads((Path(__file__).parent / "data" / "skin_manager.json").read_text())
ALIKE = (3, 123, 203, 213, 223, 233)
"""Taxels pressed in the recorded exchange around which forearm_V2, the position file that skinManager had,
has the places of a module. Around the other three it puts several taxels on one place (160, 190), or has them
mirrored (40): there the file and the frames of icub-models are 4.4 to 6.4 mm apart."""
ROWS = {
    "elbow": (-0.015, 0.0, 90.0, 0.0),
    "wrist_prosup": (0.0, 0.1413, 90.0, -90.0),
}
"""A and D [m], alpha and theta0 [deg] of the left arm in iKin (icub-main, iCubArm of V1.7 and V2; in V1 the D
of wrist_prosup is 0.1373). On the right arm, A and D have the other sign."""


def dh(a: float, d: float, alpha: float, theta: float) -> Array:
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
    )


def upper_arm_to_forearm(side: str, elbow: float, prosup: float) -> Array:
    """Pose of iDyn's link 4 in its link 2 at these angles [rad]."""
    sign, pose = 1.0 if side == "left" else -1.0, np.eye(4)
    for (a, d, alpha, theta), angle in zip(ROWS.values(), (elbow, prosup), strict=True):
        pose = pose @ dh(sign * a, sign * d, np.deg2rad(alpha), np.deg2rad(theta) + angle)
    return pose


def poke(patch: str, joints: JointReading, centre: int) -> tuple[Contacts, Array]:
    """The contact of a touch on the taxels near taxel `centre`, and the pressed channels."""
    surface = Skin(ICUB).surfaces[patch]
    near = np.argsort(np.linalg.norm(surface.positions - surface.positions[centre], axis=1))[:5]
    perceiver = Perceiver(tci.GenericBody(ICUB))
    for k in range(60):
        frames = []
        for one in ICUB.skin:
            values = np.full(one.channels, one.sensor.rest)
            if one.name == patch and k > 40:
                values[surface.channels[near]] -= 40.0
            frames.append(SkinFrame(one.name, 0.02 * k, k, values))
        moved = JointReading(0.02 * k, k, joints.position, joints.velocity)
        perception = perceiver.step(Reading(moved, tuple(frames)), 0.02 * k)
    return perception.contacts, np.sort(surface.channels[near])


@pytest.mark.parametrize("side", ["left", "right"])
def test_frames_are_those_of_ikins_parameters_in_any_posture(side: str) -> None:
    """A point that is fixed in the torso is sent once as a contact of each link: iKin's parameters must lead
    from one to the other."""
    form, chain, generator = EventForm(ICUB), KinematicChain(ICUB), np.random.default_rng(3)
    index = {servo.joint: servo.index for servo in ICUB.servos}
    links = {segment: ICUB.patch(f"{side}_{segment}").link for segment in ("upper_arm", "forearm")}
    touched = {
        segment: poke(f"{side}_{segment}", JointReading(0.0, 0, *np.zeros((2, len(ICUB.servos)))), 7)[0][0]
        for segment in links
    }
    for _ in range(20):
        position = np.zeros(len(ICUB.servos))
        elbow, prosup = generator.uniform(0.3, 1.5), generator.uniform(-0.8, 0.8)
        position[[index[f"{side[0]}_elbow"], index[f"{side[0]}_wrist_prosup"]]] = elbow, prosup
        poses = chain.poses(position, links.values())
        seen = {}
        for segment, contact in touched.items():
            (event,) = decode_events(form.encode([contact]))
            assert (event.link, event.skin_part) == {
                "upper_arm": (2, 3 if side == "left" else 6), "forearm": (4, 2 if side == "left" else 5)
            }[segment]  # fmt: skip
            pose = poses[links[segment]]
            there = pose[:3, :3] @ contact.p_L + pose[:3, 3], pose[:3, :3] @ contact.n_L
            seen[segment] = there, (event.cop, event.normal)
        # both events, brought into iDyn's link 2, lie to each other as both contacts lie in the torso frame
        turn = upper_arm_to_forearm(side, elbow, prosup)
        (p, n), (cop, normal) = seen["upper_arm"]
        (q, m), (other, outward) = seen["forearm"]
        other, outward = turn[:3, :3] @ other + turn[:3, 3], turn[:3, :3] @ outward
        assert abs(np.linalg.norm(other - cop) - np.linalg.norm(q - p)) < 3e-3
        assert (
            abs(np.degrees(np.arccos(np.clip(normal @ outward, -1, 1)) - np.arccos(np.clip(n @ m, -1, 1))))
            < 5
        )
        across = np.array([normal @ (other - cop), outward @ (other - cop)])
        np.testing.assert_allclose(across, [n @ (q - p), m @ (q - p)], atol=3e-3)


@pytest.mark.parametrize("patch", ["left_forearm", "right_forearm"])
def test_numbers_are_the_places_in_the_port_and_come_back_as_the_same_contact(patch: str) -> None:
    form = EventForm(ICUB)
    for centre in (3, 90, 180):
        contacts, pressed = poke(patch, JointReading(0.0, 0, *np.zeros((2, len(ICUB.servos)))), centre)
        events = decode_events(form.encode(contacts))
        assert sorted(events[0].taxels) == pressed.tolist()  # this port has as many values as channels
        assert all(number % 12 not in (6, 10) for number in events[0].taxels)  # thermal pads
        (back, *_) = form.in_links(events)
        assert back.frame == ICUB.patch(patch).link
        np.testing.assert_allclose(back.cop, contacts[0].p_L, atol=1e-9)
        np.testing.assert_allclose(back.normal, contacts[0].n_L, atol=1e-9)


def test_upper_arms_have_the_numbers_of_their_modules_in_768_values() -> None:
    contacts, _ = poke("left_upper_arm", JointReading(0.0, 0, *np.zeros((2, len(ICUB.servos)))), 200)
    (event, *_) = decode_events(EventForm(ICUB).encode(contacts))
    modules = ICUB.binding("yarp").entry("left_upper_arm")
    assert modules is not None
    assert {number // 12 for number in event.taxels} <= {*modules.modules}
    assert max(event.taxels) > 350


def felt(poke: dict[str, Any]) -> Contacts:
    """What TCI feels of the values that the genuine skinManager got."""
    perceiver = Perceiver(BODY)
    for k in range(20):
        values = np.full(384, float(EXCHANGE["rest"]))
        for channel, value in poke["raw"].items() if k > 10 else ():
            values[int(channel)] = value
        still = JointReading(0.02 * k, k, *np.zeros((2, len(ICUB.servos))))
        frame = SkinFrame("left_forearm", 0.02 * k, k, values)
        perception = perceiver.step(Reading(still, (frame,)), 0.02 * k)
    return perception.contacts


@pytest.mark.parametrize("poke", EXCHANGE["pokes"], ids=lambda poke: str(poke["taxel"]))
def test_the_genuine_skin_manager_tells_the_same_contact(poke: dict[str, Any]) -> None:
    """It lists what is pressed 8 counts above the noise, TCI less than that, too."""
    (theirs,) = decode_events(poke["skin_manager"])
    (ours,) = decode_events(EventForm(ICUB).encode(felt(poke)))
    assert (ours.body_part, ours.link, ours.skin_part) == (theirs.body_part, theirs.link, theirs.skin_part)
    assert set(theirs.taxels) <= set(ours.taxels)
    assert all(EXCHANGE["rest"] - poke["raw"][str(n)] < 12 for n in {*ours.taxels} - {*theirs.taxels})
    turned = ours.normal @ theirs.normal / np.linalg.norm(ours.normal) / np.linalg.norm(theirs.normal)
    assert np.degrees(np.arccos(min(turned, 1.0))) < 1.0
    if poke["taxel"] in ALIKE:
        assert np.linalg.norm(ours.cop - theirs.cop) < 3e-3


@pytest.mark.parametrize("poke", EXCHANGE["pokes"], ids=lambda poke: str(poke["taxel"]))
def test_what_is_apart_are_the_places_in_the_position_file(
    poke: dict[str, Any], genuine_data: SkinData
) -> None:
    """With the file's places of the same taxels, TCI's forces have their centre where skinManager has it."""
    rows = genuine_data.file("icub/positions/left_forearm_V2.txt").read_text().splitlines()
    table = [row.split() for row in rows if len(row.split()) == 6 and row.lstrip()[0] in "-0123456789"]
    places = np.array(table, float)[:, :3]
    (theirs,) = decode_events(poke["skin_manager"])
    (contact,) = felt(poke)
    channels = Skin(ICUB).surfaces["left_forearm"].channels[contact.taxels]
    there = contact.taxel_forces @ places[channels] / contact.taxel_forces.sum()
    assert np.linalg.norm(there - theirs.cop) < 3e-3
