"""Several readers use one skin at different rates. No reader delays another reader or the acquisition of
frames."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import tci
from helpers.felt_skin import FeltSkin, patches, skin_state
from tci.errors import TciError, UnknownNameError
from tci.messages import JointReading, SkinState
from tci.skin.regions import limb_region, patch_region, region, region_state
from tci.skin.service import SkinService


@pytest.fixture(scope="module")
def skin() -> FeltSkin:
    return FeltSkin(tci.load_robot("nao"))


def state(skin: FeltSkin, sequence: int, forces: dict[str, dict[int, float]] | None = None) -> SkinState:
    """Returns a skin state in which some taxels have forces [N]."""
    pressures = {}
    for name, surface in skin.surfaces.items():
        force = np.zeros(len(surface.positions))
        for taxel, value in (forces or {}).get(name, {}).items():
            force[taxel] = value
        pressures[name] = force / surface.areas
    return skin_state(skin.layout, pressures, stamp=0.01 * sequence, sequence=sequence)


def number(found: SkinState | None) -> int:
    assert found is not None
    return int(found.sequence[0])


def test_every_reads_all_and_latest_the_newest(skin: FeltSkin) -> None:
    service = SkinService(skin)
    service.publish(state(skin, 0))
    every, latest = service.reader("every"), service.reader("latest")
    assert every.read(timeout=0.0) is None
    for sequence in (1, 2, 3):
        service.publish(state(skin, sequence))
    assert [number(every.read(0.0)) for _ in range(3)] == [1, 2, 3]
    assert number(latest.read(0.0)) == 3
    assert every.read(0.0) is None
    assert latest.read(0.0) is None
    assert every.missed == 0


def test_the_same_state_is_published_once(skin: FeltSkin) -> None:
    service = SkinService(skin)
    reader = service.reader()
    same = state(skin, 1)
    service.publish(same)
    service.publish(same)
    assert number(reader.read(0.0)) == 1
    assert reader.read(0.0) is None


def test_a_slow_reader_misses_and_knows_how_many(skin: FeltSkin) -> None:
    service = SkinService(skin, depth=4)
    slow, quick = service.reader(), service.reader()
    for sequence in range(10):
        service.publish(state(skin, sequence))
        assert number(quick.read(0.0)) == sequence
    assert [number(slow.read(0.0)) for _ in range(4)] == [6, 7, 8, 9]
    assert (slow.missed, quick.missed) == (6, 0)


def test_on_change_of_any_patch_or_of_a_region(skin: FeltSkin) -> None:
    service = SkinService(skin)
    whole = service.reader("change", step=0.5)
    head = service.reader("change", region=patch_region(skin, "head"))
    service.publish(state(skin, 0))
    assert number(whole.read(0.0)) == number(head.read(0.0)) == 0
    service.publish(state(skin, 1, {"left_forearm": {3: 0.4}}))
    assert whole.read(0.0) is None
    service.publish(state(skin, 2, {"left_forearm": {3: 0.6}}))
    assert number(whole.read(0.0)) == 2
    assert head.read(0.0) is None
    service.publish(state(skin, 3, {"left_forearm": {3: 0.6}, "head": {1: 1.0}}))
    assert number(head.read(0.0)) == 3


def test_many_readers_in_threads_get_all_that_is_published(skin: FeltSkin) -> None:
    service = SkinService(skin, depth=1000)
    count, seen = 500, [[] for _ in range(20)]

    def read(into: list[int], reader: object) -> None:
        while len(into) < count:
            found = reader.read(5.0)
            if found is None:
                return
            into.append(number(found))

    threads = [threading.Thread(target=read, args=(into, service.reader())) for into in seen]
    for thread in threads:
        thread.start()
    states = [state(skin, sequence) for sequence in range(count)]
    for one in states:
        service.publish(one)
    for thread in threads:
        thread.join()
    assert all(into == list(range(count)) for into in seen)


def test_figures_of_a_region(skin: FeltSkin) -> None:
    forearm = skin.surfaces["left_forearm"]
    own = region(skin, "mine", {"left_forearm": [3, 4, 5], "head": [1]})
    felt = state(skin, 1, {"left_forearm": {3: 1.0, 9: 5.0}, "head": {1: 0.5}})
    figures = region_state(skin, own, felt)
    assert figures.force == pytest.approx(1.5)
    assert figures.active == 2
    assert figures.area == pytest.approx(forearm.areas[3] + skin.surfaces["head"].areas[1])
    pressures = [1.0 / forearm.areas[3], 0.5 / skin.surfaces["head"].areas[1]]
    assert figures.peak_pressure == pytest.approx(max(pressures))
    assert figures.mean_pressure == pytest.approx(np.mean(pressures))
    assert figures.coverage == 1.0
    silent = skin_state(skin.layout, {"head": patches(skin, felt)["head"].pressure})
    assert region_state(skin, own, silent).coverage == 0.25
    reader = SkinService(skin).reader(region=own)
    assert reader.figures(felt) == figures


def test_a_region_around_a_place_on_the_limb(skin: FeltSkin) -> None:
    count = len(skin.robot.servos)
    at = JointReading(0.0, 0, np.zeros(count), np.zeros(count))
    place = limb_region(skin, "wrist", "left_arm", "forearm", u=0.7, theta=0.0, radius=0.2, joints=at)
    u, theta, _ = skin.limb("left_forearm", at)
    own = place.taxels["left_forearm"]
    assert 3 < len(own) < len(u)
    assert np.abs(u[own] - 0.7).max() < 0.2
    assert np.abs(theta[own]).max() < np.pi / 2


def test_faults(skin: FeltSkin) -> None:
    service = SkinService(skin)
    with pytest.raises(UnknownNameError, match="every, latest, change"):
        service.reader("sometimes")
    with pytest.raises(TciError, match="1 or more"):
        SkinService(skin, depth=0)
    with pytest.raises(TciError, match="step"):
        service.reader(step=-1.0)
    with pytest.raises(TciError, match="no region"):
        service.reader().figures(state(skin, 0))
    for taxels in ([240], [-1], [1, 1], [0.5]):
        with pytest.raises(TciError, match="0 to 239"):
            region(skin, "bad", {"left_forearm": taxels})
    with pytest.raises(TciError, match="no taxels"):
        region(skin, "bad", {})
    with pytest.raises(UnknownNameError, match="left_forearm"):
        region(skin, "bad", {"tail": [1]})
