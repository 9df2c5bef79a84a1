"""Receptive fields on the page: which places belong to a field, and the names in the legend."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from viser._viser import CameraHandle, _CameraHandleState

from tci.capabilities.arbiter import Arbiter
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.contact_stop import ContactStop
from tci.capabilities.fields import default_fields
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.capabilities.wrapper import CapabilityWrapper
from tci.lab.viewer.fields import fields_of, is_outside, legend, nearest_field
from tci.lab.viewer.framing import Framing

FIELDS = default_fields()


def contact(**place: Any) -> Any:
    known = {"segment": "forearm", "u": 0.5, "theta": 0.0}
    return SimpleNamespace(**(known | place))


def test_the_middle_of_each_field_lies_in_it_and_elsewhere_is_none() -> None:
    for index, field in enumerate(FIELDS):
        assert nearest_field(FIELDS, field.segment, field.u, field.theta) == index
        assert not is_outside(FIELDS, contact(segment=field.segment, u=field.u, theta=field.theta))
    assert is_outside(FIELDS, contact(u=5.0))
    assert is_outside(FIELDS, contact(segment="", u=np.nan, theta=np.nan))
    assert not is_outside((), contact(u=5.0))


def test_only_fields_on_limbs_are_shown() -> None:
    assert fields_of(WithdrawalReflex()) == FIELDS
    assert fields_of(BodyWithdrawal()) == ()
    layers = Arbiter([BodyWithdrawal(), CapabilityWrapper(ContactStop(WithdrawalReflex()))])
    assert fields_of(CapabilityWrapper(layers)) == FIELDS


def test_the_legend_has_a_colour_of_its_own_for_each_field_and_one_for_none() -> None:
    shown = legend(FIELDS)
    assert len(set(re.findall(r"rgb\([^)]*\)", shown))) == len(FIELDS) + 1
    assert all(field.name.replace("_", " ") in shown for field in FIELDS)
    assert "outside all fields" in shown


@pytest.mark.parametrize("aspect", [0.2, 0.46, 0.8, 1.3, 3.0])
def test_all_robots_are_in_a_picture_of_any_shape(aspect: float) -> None:
    server = Mock()
    framing = Framing(server, Mock(), width=1.35, height=1.05)
    away = np.linalg.norm(np.array(server.initial_camera.position) - np.array(server.initial_camera.look_at))
    up = 2.0 * away * np.tan(framing.angle(aspect) / 2.0)
    assert up > 1.05
    assert up * aspect > 1.35


def test_a_window_that_is_folded_away_keeps_its_camera_and_does_not_end_the_others() -> None:
    def looks(width: int, height: int) -> Any:
        state = _CameraHandleState(
            Mock(), np.zeros(4), np.zeros(3), 0.5, height, width, 0.1, 10.0, 0.1, 10.0, np.zeros(3),
            np.zeros(3), 1.0, [],
        )  # fmt: skip
        client = Mock(camera=CameraHandle(Mock()))
        client.camera._state = state
        return client

    clients = {0: looks(800, 0), 1: looks(0, 600), 2: looks(800, 600)}
    framing = Framing(Mock(get_clients=lambda: clients), Mock(), width=1.35, height=1.05)
    framing.update()
    assert [client.camera.fov for client in clients.values()] == [0.5, 0.5, framing.angle(800 / 600)]
