"""Contacts of a single taxel are either touches or sensor defects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest

import tci
from helpers.felt_skin import FeltSkin, contacts_of, skin_state
from helpers.robot_groups import two_armed
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import TciError
from tci.messages import Contact, JointReading, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.description import Sensor
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.health import Health
from tci.skin.isolated import IsolatedSettings
from tci.skin.layout import SkinLayout, normal_channels
from tci.skin.skin import Skin

ARM = "left_forearm"
PERIOD = 0.02
ISOLATED = 100
"""A taxel that has six neighbours."""
LIGHT, FIRM = 0.3, 6.0
"""Forces [N] of a light and of a firm touch."""


class Felt:
    """Processes frames of one patch of a robot, and finds the contacts in these frames."""

    def __init__(self, robot: str = "nao", patch: str = ARM) -> None:
        self.skin, self.patch = FeltSkin(tci.load_robot(robot)), patch
        self.finder = ContactFinder(self.skin.layout)
        self.surface = self.skin.surfaces[patch]
        self.frame = 0

    def beside(self, taxel: int) -> list[int]:
        pairs = self.surface.neighbours
        return sorted({int(i) for pair in pairs if taxel in pair for i in pair} - {taxel})

    def see(self, forces: dict[int, float]) -> Sequence[Contact]:
        """Returns the contacts of the next frame, in which some taxels have forces [N]."""
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


def beside_one() -> Felt:
    """Returns a skin in which one taxel has a single neighbour."""
    felt = Felt()
    pairs = np.array([[ISOLATED, felt.beside(ISOLATED)[0]]])
    patches = [
        replace(one, surface=replace(one.surface, neighbours=pairs)) if one.description.name == ARM else one
        for one in felt.skin.layout.patches
    ]
    felt.skin.layout = SkinLayout.of(patches)
    felt.finder = ContactFinder(felt.skin.layout)
    return felt


def noise_of(sensor: Sensor, counts: float) -> float:
    """Returns a noise [counts] that is realistic for a sensor: a switch has nearly no noise."""
    return min(counts, 0.01 * (sensor.highest - sensor.lowest))


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("name", [name for name in (*two_armed(), "franka") if "bare" not in name])
def test_more_force_is_never_felt_less(name: str, noise: float) -> None:
    """Presses one taxel on each skin of each robot, with forces from below the threshold to the end of the
    range, where a constant value could also be that of a stuck taxel."""
    skin, chance = FeltSkin(tci.load_robot(name)), np.random.default_rng(1)
    still = np.zeros(len(skin.robot.servos))
    joints = JointReading(0.0, 0, still, still)
    pressed = {name: int(chance.integers(len(one.areas))) for name, one in skin.surfaces.items()}
    for p, patch in enumerate(skin.layout.patches):
        estimator, own = skin.conditioner.estimators[p], skin.layout.taxels[p]
        estimator.baseline.start(np.zeros(own.stop - own.start), noise_of(patch.description.sensor, noise))
        estimator.write(own, skin.conditioner.estimates)
    felt = {name: list[bool]() for name in pressed}
    for step, force in enumerate(np.geomspace(0.05, 40.0, 7)):
        finder = ContactFinder(skin.layout)
        for frame in range(26):
            now, frames = step + frame / 50.0, []
            for patch in skin.robot.patches:
                sensor, surface = patch.sensor, skin.surfaces[patch.name]
                own, at = noise_of(sensor, noise), pressed[patch.name]
                counts = own * chance.standard_normal(patch.channels * sensor.axes)
                most = 0.85 * max(sensor.highest - sensor.rest, sensor.rest - sensor.lowest) - 3.0 * own
                if frame > 0:
                    more = min(float(sensor.counts(force / surface.areas[at])), most)
                    counts[normal_channels(patch, surface)[at]] += more
                raw = np.rint(sensor.rest + np.sign(sensor.pascal_per_count) * counts)
                values = read_only(np.clip(raw, sensor.lowest, sensor.highest))
                frames.append(SkinFrame(patch.name, now, 100 * step + frame, values))
            skin.conditioner.step(frames)
            seen = contacts_of(skin, skin.conditioner.state, joints, finder=finder)
        for patch, taxel in pressed.items():
            felt[patch].append(any(c.patch == patch and taxel in c.taxels for c in seen))
    assert all(found == sorted(found) and found[-1] for found in felt.values()), felt


def test_a_taxel_that_is_stuck_beside_silent_ones_is_never_a_touch() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    assert not any(felt.see({ISOLATED: FIRM}) for _ in range(100))
    felt.finder = ContactFinder(felt.skin.layout, ContactSettings(isolated=None))
    assert len(felt.see({ISOLATED: FIRM})) == 1


@pytest.mark.parametrize("force", [LIGHT, FIRM])
def test_a_touch_of_one_taxel_comes_later_and_stays(force: float) -> None:
    felt = Felt()
    came = [bool(felt.see({ISOLATED: force})) for _ in range(40)]
    assert came.index(True) == pytest.approx(0.2 / PERIOD, abs=1)
    assert all(came[came.index(True) :])


def test_a_taxel_at_the_end_of_its_range_is_a_touch_if_it_rose_and_stuck_if_it_jumped() -> None:
    felt = Felt()
    full = float(240 * 420.0 * felt.surface.areas[ISOLATED])
    assert not any(felt.see({ISOLATED: full}) for _ in range(40))
    felt.see({})
    came = [bool(felt.see({ISOLATED: min(0.3 * full * (i + 1), full)})) for i in range(40)]
    assert all(came[10:])


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


def test_a_touch_over_a_stuck_taxel_is_felt_and_leaves_nothing_behind() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    touch = dict.fromkeys(felt.beside(ISOLATED), 0.5)
    assert not felt.see({ISOLATED: FIRM})
    (over,) = felt.see({ISOLATED: FIRM, **touch})
    assert len(over.taxels) == 7
    assert not [felt.see({ISOLATED: FIRM}) for _ in range(12)][-1], "the stuck one does not go on as a touch"


def test_a_stuck_taxel_under_a_touch_that_has_ended_goes_on_for_a_moment_only() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    assert felt.see({ISOLATED: 2.0, felt.beside(ISOLATED)[0]: 0.5})
    left = [bool(felt.see({ISOLATED: 2.0})) for _ in range(40)]
    assert left.index(False) == pytest.approx(0.2 / PERIOD, abs=1)
    assert not any(left[left.index(False) :])
    felt.see({ISOLATED: 2.0, felt.beside(ISOLATED)[0]: 0.5})
    assert all(felt.see({ISOLATED: 2.0 + 0.04 * (i % 3)}) for i in range(40)), "a touch lives"


def test_a_touch_elsewhere_is_felt_beside_a_stuck_taxel() -> None:
    felt = Felt()
    felt.set_noise(1.0)
    assert not any(felt.see({ISOLATED: FIRM}) for _ in range(12))
    apart = np.linalg.norm(felt.surface.positions - felt.surface.positions[ISOLATED], axis=1)
    near = next(i for i in np.flatnonzero(apart < 0.03).tolist() if apart[felt.beside(i)].min() > 0.015)
    for taxel in (10, near):
        (contact,) = felt.see({ISOLATED: FIRM, taxel: 1.0, felt.beside(taxel)[0]: 0.4})
        assert taxel in contact.taxels
        assert ISOLATED not in contact.taxels


@pytest.mark.parametrize("force", [LIGHT, FIRM])
def test_where_neighbours_tell_nothing_one_taxel_is_a_touch_at_once(force: float) -> None:
    felt = Felt()
    place = felt.skin.layout.places[ARM]
    estimator, own = felt.skin.conditioner.estimators[place], felt.skin.layout.taxels[place]
    estimator.health.state[felt.beside(ISOLATED)] = Health.DEAD
    estimator.write(own, felt.skin.conditioner.estimates)
    assert len(felt.see({ISOLATED: force})) == 1, "masked neighbours"
    assert len(beside_one().see({ISOLATED: force})) == 1, "one neighbour says nothing"


@pytest.mark.parametrize("patch", ["head", "left_hand", "left_sole", "left_bumper"])
def test_switches_and_coarse_skins_have_touches_of_one_taxel(patch: str) -> None:
    felt = Felt("nao-whole", patch)
    assert len(felt.see({0: 1.0})) == 1


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
