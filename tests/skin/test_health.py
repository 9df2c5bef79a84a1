"""Faulty taxels are masked and reported. They are used again when they work again."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.flat_skin import OnePatch
from helpers.long_skin import PASCAL, TAXELS, conditioner, grid
from tci.errors import TciError
from tci.skin.health import HealthSettings

RATE = 10.0


class Bench:
    """A patch with noise of one count, which receives frames at 10 Hz."""

    def __init__(self) -> None:
        self.subject: OnePatch = conditioner()
        self.time = 0.0
        self.generator = np.random.default_rng(7)
        self.feed(30.0)

    def feed(self, seconds: float, **raw: float | np.ndarray) -> np.ndarray:
        """Processes frames in which the taxels `t12=...` send this value. Returns the pressures (frames,
        taxels)."""
        felt = []
        for _ in range(int(seconds * RATE)):
            values = np.rint(self.subject.patch.sensor.rest + self.generator.standard_normal(TAXELS))
            for name, value in raw.items():
                if name == "all":
                    values[:] = value
                else:
                    values[int(name[1:])] = value
            self.time += 1.0 / RATE
            felt.append(self.subject.pressure(np.clip(values, 0.0, 255.0), self.time))
        return np.array(felt)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_taxel_stuck_high_is_masked_and_comes_back(bench: Bench) -> None:
    felt = bench.feed(90.0, t100=0.0)
    assert felt[0, 100] > 0.0
    assert felt[-1, 100] == 0.0
    assert np.count_nonzero(np.diff((felt[:, 100] > 0.0).astype(int))) == 1, "it goes off once: no storm"
    assert dict(bench.subject.health.masked) == {100: "stuck"}
    assert bench.subject.health.coverage == pytest.approx(1.0 - 1.0 / TAXELS)
    assert bench.subject.masked[100]
    bench.feed(10.0)
    assert bench.subject.health.coverage == 1.0


def test_taxel_stuck_anywhere_all_alone_is_masked_after_two_windows(bench: Bench) -> None:
    bench.feed(11.0, t100=200.0)  # a window contains 50 frames, which is 5 s
    assert dict(bench.subject.health.masked) == {100: "stuck"}
    bench.feed(5.0, t100=bench.subject.patch.sensor.rest)
    assert bench.subject.health.coverage == 1.0
    bench.feed(11.0, t100=200.0, t101=200.0)
    assert bench.subject.health.coverage == 1.0, "a press of two, however still"


def test_taxel_stuck_low_is_masked(bench: Bench) -> None:
    bench.feed(90.0, t5=bench.subject.patch.sensor.rest)
    assert dict(bench.subject.health.masked) == {5: "dead"}


def test_dead_patch_has_no_coverage(bench: Bench) -> None:
    bench.feed(90.0, all=np.full(TAXELS, 240.0))
    assert bench.subject.health.coverage == 0.0


def test_saturated_press_of_several_taxels_stays_a_touch_for_half_an_hour(bench: Bench) -> None:
    pressed = {f"t{taxel}": 0.0 for taxel in (100, 101, 120, 121)}
    felt = bench.feed(1800.0, **pressed)[:, [100, 101, 120, 121]]
    assert bench.subject.health.saturated == 4
    assert bench.subject.health.coverage == 1.0
    assert (np.abs(felt / felt[0] - 1.0) < 0.1).all()
    assert felt.max() <= 256.0 * PASCAL


def test_noisy_taxel_is_masked_and_comes_back(bench: Bench) -> None:
    for _ in range(600):
        bench.feed(0.1, t40=235.0 + 20.0 * bench.generator.standard_normal())
    assert dict(bench.subject.health.masked) == {40: "noisy"}
    assert not bench.feed(1.0, t40=150.0)[:, 40].any()
    bench.feed(60.0)
    assert bench.subject.health.coverage == 1.0


def test_a_step_of_the_baseline_is_rest_after_a_request(bench: Bench) -> None:
    step = {f"t{taxel}": 200.0 for taxel in range(0, TAXELS, 3)}
    assert bench.feed(5.0, **step)[-1].any()
    bench.subject.rezero()
    felt = bench.feed(30.0, **step)
    assert not felt[100:].any()


def test_the_same_frames_give_the_same_bits() -> None:
    one, other = Bench(), Bench()
    np.testing.assert_array_equal(one.feed(20.0, t3=120.0), other.feed(20.0, t3=120.0))
    np.testing.assert_array_equal(one.subject.baseline.offset, other.subject.baseline.offset)


@pytest.mark.parametrize("begins", [0.0, 1.2, 3.7])
@pytest.mark.parametrize("lasts", [12.0, 91.3])
def test_a_taxel_that_was_frozen_keeps_its_rest_value(bench: Bench, begins: float, lasts: float) -> None:
    """The taxel freezes at a value that no pressure can cause. The fault begins at different times of an
    estimation window."""
    bench.feed(begins)
    known = bench.subject.baseline.offset[100]
    bench.feed(lasts, t100=252.0)
    felt = bench.feed(20.0)
    assert bench.subject.baseline.offset[100] == pytest.approx(known, abs=0.5)
    assert not felt.any()


def test_a_taxel_quieter_than_its_patch_is_at_rest_or_pressed(bench: Bench) -> None:
    """A change of the rest value of this taxel is smaller than the threshold of its patch, and larger than
    seven standard deviations of the taxel's own noise."""
    quiet = bench.subject.patch.sensor.rest + 0.4 * bench.generator.standard_normal(900)
    for place, value in enumerate(quiet):
        bench.feed(0.1, t100=np.rint(value - (4.5 if place > 200 else 0.0)))
    assert 7.0 * bench.subject.baseline.noise[100] < 4.5 < bench.subject.baseline.threshold[100]
    assert bench.subject.baseline.offset[100] > 3.0


@pytest.mark.parametrize("bad", [{"constant": 0.0}, {"noisy": -1.0}, {"flicker": np.nan}])
def test_settings_that_make_no_sense(bad: dict[str, float]) -> None:
    with pytest.raises(TciError, match="health"):
        HealthSettings(**bad)


def test_grid_is_one_patch() -> None:
    assert len(grid()) == 12 * 19 + 11 * 20


@pytest.mark.parametrize("share", [0.5, 0.7, 0.85])
@pytest.mark.parametrize("segment", ["foot", "forearm"])
def test_a_start_under_load_masks_no_sound_taxel(segment: str, share: float) -> None:
    """A robot stands on its sole or lies on its skin before the first frame. The rest values of its taxels
    differ from those of the description."""
    subject, chance = conditioner(segment=segment), np.random.default_rng(2)
    sensor = subject.patch.sensor
    load = np.where(np.arange(TAXELS) < share * TAXELS, chance.uniform(20.0, 120.0, TAXELS), 0.0)
    scatter = chance.uniform(-4.0, 4.0, TAXELS)

    def feed(begin: float, end: float, counts: np.ndarray) -> np.ndarray:
        for now in np.arange(begin, end, 1.0 / RATE):
            values = sensor.rest - counts - scatter + 1.2 * chance.standard_normal(TAXELS)
            felt = subject.pressure(np.clip(np.rint(values), 0.0, 255.0), float(now))
            assert subject.health.coverage == 1.0
        return felt

    feed(0.0, 60.0, load)
    touch = np.zeros(TAXELS)
    touch[-12:] = 60.0
    assert (feed(60.0, 61.0, load + touch)[-12:] > 0.0).all()
    assert not feed(61.0, 90.0, np.zeros(TAXELS))[load > 0.0].any(), "it got up"


def test_a_robot_that_lies_on_all_of_a_skin_feels_again_once_it_got_up() -> None:
    subject, chance = conditioner(), np.random.default_rng(2)

    def feed(begin: float, end: float, counts: float | np.ndarray) -> np.ndarray:
        for now in np.arange(begin, end, 1.0 / RATE):
            values = subject.patch.sensor.rest - counts + 1.2 * chance.standard_normal(TAXELS)
            felt = subject.pressure(np.clip(np.rint(values), 0.0, 255.0), float(now))
        return felt

    touch = np.zeros(TAXELS)
    touch[:12] = 60.0
    assert feed(0.0, 20.0, 80.0).all()
    assert not feed(20.0, 60.0, 80.0).any(), "lying is rest now"
    feed(60.0, 80.0, 0.0)
    assert np.flatnonzero(feed(80.0, 81.0, touch)).tolist() == [*range(12)]
    assert subject.health.coverage == 1.0
