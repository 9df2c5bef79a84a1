"""The programs of iCub's tutorials move the arm of a served iCub to the commanded angles, in both
dialects."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from helpers.yarp_show import Show
from helpers.yarp_tutorials import (
    BACK,
    FIRST,
    THERE,
    ArmClient,
    tutorial_arm,
    tutorial_arm_joint_impedance,
)
from yarpwire.board import COMPLIANT, STIFF
from yarpwire.dialect import DIALECTS


@pytest.fixture(scope="module", params=list(DIALECTS))
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ArmClient]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YARP_CONFIG_HOME", str(tmp_path_factory.mktemp("yarp")))
        show = Show(DIALECTS[request.param], "icub", paced=False)

        def delay(seconds: float) -> None:
            until = show.driver.clock.now() + seconds
            while show.driver.clock.now() < until:
                time.sleep(0.001)

        client = ArmClient(show, delay)
        yield client
        client.close()
        show.close()


def test_the_tutorial_of_the_arm_ends_where_it_says(arm: ArmClient) -> None:
    for angles, goal in zip(tutorial_arm(arm), (FIRST, FIRST, BACK), strict=True):
        np.testing.assert_allclose(angles[:4], goal, atol=1.0)


def test_the_tutorial_of_impedance_ends_where_it_says_stiff_and_compliant(arm: ArmClient) -> None:
    (there, soft), (back, stiff) = tutorial_arm_joint_impedance(arm)
    assert (soft, stiff) == (COMPLIANT, STIFF)
    np.testing.assert_allclose(there[:3], THERE[:3], atol=1.0)
    np.testing.assert_allclose(there[3], THERE[3], atol=8.0)  # gravity lowers an elbow with low stiffness
    np.testing.assert_allclose(back[:4], BACK, atol=1.0)
