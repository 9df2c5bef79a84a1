"""Contacts of a single taxel: light touches, or sensor defects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest

import tci
from felt_skin import AT_ONCE, FeltSkin, contacts_of, skin_state
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import TciError
from tci.frames import read_only
from tci.messages import Contact, JointReading, Reading, SkinFrame
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.health import Health
from tci.skin.isolated import IsolatedSettings
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin

ARM = "left_forearm"
PERIOD = 0.02
ISOLATED = 100
"""A taxel with six neighbours around it."""
LIGHT, FIRM = 0.3, 9.0
"""Force [N] to which neighbours need not respond, and one to which they must."""


class Felt:
    """Frames of one patch of a robot, and the contacts found in them."""

    def __init__(self, robot: str = "nao", patch: str = ARM) -> None:
        self.skin, self.patch = FeltSkin(tci.load_robot(robot)), patch
        self.finder = ContactFinder(self.skin.layout)
        self.surface = self.skin.surfaces[patch]
        self.frame = 0

    def beside(self, taxel: int) -> list[int]:
        pairs = self.surface.neighbours
        return sorted({int(i) for pair in pairs if taxel in pair for i in pair} - {taxel})

    def see(self, forces: dict[int, float]) -> Sequence[Contact]:
        """Returns the contacts of the next frame, with forces [N] on some taxels."""
        force = np.zeros(len(self.surface.positions))
        force[list(forces)] = list(forces.values())
        still = np.zeros(len(self.skin.robot.servos))
        joints = JointReading(0.0, 0, still, still)
        self.frame += 1
        pressure = {self.patch: force / self.surface.areas}
        state = skin_state(self.skin.layout, pressure, stamp=self.frame * PERIOD, sequence=self.frame)
        return contacts_of(self.skin, state, joints, finder=self.finder)

    def set_noise(self, counts: float) -> None:
        """Sets the noise [counts] of all taxels at rest."""
        place = self.skin.layout.places[self.patch]
        estimator, own = self.skin.conditioner.estimators[place], self.skin.layout.taxels[place]
        estimator.baseline.start(np.zeros(own.stop - own.start), counts)
        estimator.write(own, self.skin.conditioner.estimates)


def beside_some(count: int) -> Felt:
    """Returns a skin where a taxel has `count` neighbours, all on one side."""
    felt = Felt()
    beside, at = felt.beside(ISOLATED), felt.surface.positions
    nearest = sorted(beside, key=lambda other: float(np.linalg.norm(at[other] - at[beside[0]])))[:count]
    pairs = np.array([[ISOLATED, other] for other in nearest])
    patches = [
        replace(one, surface=replace(one.surface, neighbours=pairs)) if one.description.name == ARM else one
        for one in felt.skin.layout.patches
    ]
    felt.skin.layout = SkinLayout.of(patches)
    felt.finder = ContactFinder(felt.skin.layout)
    return felt


def test_a_taxel_that_is_pressed_hard_beside_silent_ones_is_never_a_touch() -> None:
    felt = Felt()
    assert not any(felt.see({ISOLATED: FIRM}) for _ in range(100))
    felt.finder = ContactFinder(felt.skin.layout, ContactSettings(isolated=None))
    assert len(felt.see({ISOLATED: FIRM})) == 1


def test_a_light_touch_of_one_taxel_comes_later_and_stays() -> None:
    felt = Felt()
    came = [bool(felt.see({ISOLATED: LIGHT})) for _ in range(40)]
    assert came.index(True) == pytest.approx(0.2 / PERIOD, abs=1)
    assert all(came[came.index(True) :])


def test_a_light_touch_of_a_taxel_that_flickers_at_rest_flickers_too() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    assert not any(felt.see({ISOLATED: LIGHT}) for _ in range(100)), "it is stuck"
    assert not any(felt.see({ISOLATED: LIGHT + 0.01}) for _ in range(100)), "a new estimate of its rest"
    felt.see({})
    came = [bool(felt.see({ISOLATED: LIGHT + 0.01 * (i % 2)})) for i in range(40)]
    assert came.index(True) == pytest.approx(0.2 / PERIOD, abs=1)


def test_a_light_touch_that_wavers_begins_to_wait_anew() -> None:
    felt = Felt()
    flicker = [bool(felt.see({ISOLATED: LIGHT} if i % 10 else {})) for i in range(200)]
    assert not any(flicker)


def test_a_touch_of_several_taxels_is_felt_at_once_and_to_its_weak_end() -> None:
    felt = Felt()
    assert len(felt.see({ISOLATED: 1.0, felt.beside(ISOLATED)[0]: 0.2})) == 1
    assert len(felt.see({ISOLATED: LIGHT})) == 1, "its other taxel has gone, the touch goes on"
    assert len(felt.see({ISOLATED: LIGHT})) == 1
    assert not felt.see({})
    assert not felt.see({ISOLATED: LIGHT}), "and it is another touch after it"


def test_a_touch_over_a_broken_taxel_is_felt_and_leaves_nothing_behind() -> None:
    felt = Felt()
    touch = dict.fromkeys(felt.beside(ISOLATED), 0.5)
    assert not felt.see({ISOLATED: FIRM})
    (over,) = felt.see({ISOLATED: FIRM, **touch})
    assert len(over.taxels) == 7
    assert not felt.see({ISOLATED: FIRM}), "the broken one does not go on as a touch"


def test_a_stuck_taxel_under_a_touch_that_has_ended_goes_on_for_a_moment_only() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    assert felt.see({ISOLATED: 2.0, felt.beside(ISOLATED)[0]: 0.5})
    left = [bool(felt.see({ISOLATED: 2.0})) for _ in range(40)]
    assert left.index(False) == pytest.approx(0.2 / PERIOD, abs=1)
    assert not any(left[left.index(False) :])
    felt.see({ISOLATED: 2.0, felt.beside(ISOLATED)[0]: 0.5})
    assert all(felt.see({ISOLATED: 2.0 + 0.04 * (i % 3)}) for i in range(40)), "a touch lives"


def test_a_touch_elsewhere_is_felt_beside_a_broken_taxel() -> None:
    felt = Felt()
    (contact,) = felt.see({ISOLATED: FIRM, 10: 1.0, felt.beside(10)[0]: 0.4})
    assert 10 in contact.taxels
    assert ISOLATED not in contact.taxels


@pytest.mark.parametrize("force", [LIGHT, FIRM])
def test_where_neighbours_tell_nothing_one_taxel_is_a_touch_at_once(force: float) -> None:
    felt = Felt()
    place = felt.skin.layout.places[ARM]
    estimator, own = felt.skin.conditioner.estimators[place], felt.skin.layout.taxels[place]
    estimator.health.state[felt.beside(ISOLATED)] = Health.DEAD
    estimator.write(own, felt.skin.conditioner.estimates)
    assert len(felt.see({ISOLATED: force})) == 1, "masked neighbours"
    pair = beside_some(1)
    assert len(pair.see({ISOLATED: force})) == 1, "one neighbour says nothing"


def test_at_a_corner_of_a_skin_where_a_touch_may_be_beside_it_time_tells() -> None:
    felt = beside_some(2)
    came = [bool(felt.see({ISOLATED: FIRM})) for _ in range(40)]
    assert came.index(True) == pytest.approx(0.2 / PERIOD, abs=1)


@pytest.mark.parametrize("patch", ["head", "left_hand", "left_sole", "left_bumper"])
def test_switches_and_coarse_skins_have_touches_of_one_taxel(patch: str) -> None:
    felt = Felt("nao-whole", patch)
    assert len(felt.see({0: 1.0})) == 1


def test_forces_that_neighbours_must_feel_follow_from_noise_and_distance() -> None:
    """The force is about 1 N on a skin of 10 mm pitch without noise, five times that with a noise of one
    count, and infinite on 30 mm."""
    felt = Felt()
    felt.finder = ContactFinder(felt.skin.layout, AT_ONCE)  # nothing waits for the next frame

    def largest() -> float:
        return float(max(force for force in np.geomspace(0.2, 50.0, 200) if felt.see({ISOLATED: force})))

    assert largest() == pytest.approx(1.1, abs=0.2)
    felt.set_noise(1.0)
    assert largest() == pytest.approx(4.8, abs=0.5)


def test_a_light_touch_is_the_same_from_senders_of_changes() -> None:
    robot = tci.load_robot("nao")
    patch, still = robot.patch(ARM), read_only(np.zeros(len(robot.servos)))
    values = np.full(patch.channels, patch.sensor.rest)
    pressed = values.copy()
    pressed[Skin(robot).surfaces[ARM].channels[ISOLATED]] -= 8.0
    seen = []
    for keep_alive in (None, 1.0):
        perceiver, touched = Perceiver(GenericBody(robot), keep_alive=keep_alive), []
        frame = SkinFrame(ARM, 0.0, 0, read_only(values))
        for i in range(int(1.0 * patch.rate)):
            now = i / patch.rate
            raw = values if now < 0.5 else pressed
            if keep_alive is None or not np.array_equal(raw, frame.values):
                frame = SkinFrame(ARM, now, i, read_only(raw))
            reading = Reading(JointReading(now, i, still, still), (frame,))
            touched.append([c.taxels.tolist() for c in perceiver.step(reading, now).contacts])
        assert any(touched)
        seen.append(touched)
    assert seen[0] == seen[1]


@pytest.mark.parametrize("field", [field.name for field in fields(IsolatedSettings)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_settings_that_make_no_sense_are_refused(field: str, value: float) -> None:
    with pytest.raises(TciError, match=f"isolated taxels: {field} {value}; valid: above 0 and finite"):
        replace(IsolatedSettings(), **{field: value})
