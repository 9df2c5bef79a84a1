"""Raw frames are converted to pressures. Invalid values never become pressures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from helpers.flat_skin import OnePatch, skin_patch
from tci.errors import FrameError
from tci.robot.description import Sensor

FALLING = Sensor(rest=240.0, pascal_per_count=-900.0, lowest=0.0, highest=255.0)
RISING = Sensor(rest=10.0, pascal_per_count=50.0, lowest=0.0, highest=4095.0)


def conditioner(sensor: Sensor) -> OnePatch:
    """Returns a conditioner of ten taxels in a frame of 12 channels. Channels 6 and 10 are thermal pads."""
    return OnePatch(skin_patch(sensor, np.array([0, 1, 2, 3, 4, 5, 7, 8, 9, 11]), width=12))


def test_iCub_sensor_falls_with_pressure() -> None:
    values = np.full(12, 240, np.uint8)
    values[[1, 11]] = 239, 0
    pressure = conditioner(FALLING).pressure(values)
    np.testing.assert_array_equal(pressure, [0, 900, 0, 0, 0, 0, 0, 0, 0, 240 * 900])


def test_sensor_that_rises_with_pressure() -> None:
    values = np.full(12, 10, np.uint16)
    values[2] = 4095
    assert conditioner(RISING).pressure(values)[2] == 50.0 * 4085


def test_pull_below_rest_is_no_pressure() -> None:
    assert not conditioner(FALLING).pressure(np.full(12, 255, np.uint8)).any()


def test_pads_never_enter() -> None:
    values = np.full(12, 240.0)
    values[[6, 10]] = 0.0, np.nan
    subject = conditioner(FALLING)
    assert not subject.pressure(values).any()
    assert subject.dropped == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 256.0, -1.0, 1e308, -1e308])
def test_what_no_sensor_sends_is_dropped_and_counted(bad: float) -> None:
    subject = conditioner(FALLING)
    values = np.full(12, 140.0)
    values[[0, 5]] = bad
    with np.errstate(all="raise"):
        pressure = subject.pressure(values)
    np.testing.assert_array_equal(np.flatnonzero(pressure == 0.0), [0, 5])
    assert subject.dropped == 2
    subject.pressure(values)
    assert subject.dropped == 4


@pytest.mark.parametrize("shape", [(0,), (11,), (13,), (1, 12), ()])
def test_wrong_count_names_patch_expected_and_got(shape: tuple[int, ...]) -> None:
    with pytest.raises(FrameError) as caught:
        conditioner(FALLING).pressure(np.zeros(shape, np.uint8))
    for word in ("skin", "(12,)", str(shape)):
        assert word in str(caught.value)


@pytest.mark.parametrize("dtype", [complex, object, "U3", bool, "datetime64[s]"])
def test_wrong_type_is_refused(dtype: str) -> None:
    with pytest.raises(FrameError, match="skin: frame of type"):
        conditioner(FALLING).pressure(np.zeros(12, dtype))


@given(
    hnp.arrays(
        st.sampled_from([np.uint8, np.int8, np.int32, np.uint64, np.float16, np.float32, np.float64]),
        12,
    ),
    st.sampled_from([FALLING, RISING]),
)
def test_pressure_is_finite_and_never_negative(values: np.ndarray, sensor: Sensor) -> None:
    pressure = conditioner(sensor).pressure(values)
    largest = max((raw - sensor.rest) * sensor.pascal_per_count for raw in (sensor.lowest, sensor.highest))
    assert pressure.dtype == np.float64
    assert pressure.shape == (10,)
    assert ((pressure >= 0.0) & (pressure <= largest)).all()


@given(st.integers(0, 255), st.integers(0, 255))
def test_more_force_is_never_less_pressure(one: int, other: int) -> None:
    low, high = (conditioner(FALLING).pressure(np.full(12, raw, np.uint8))[0] for raw in sorted((one, other)))
    assert low >= high
