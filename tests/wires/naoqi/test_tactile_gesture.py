"""The served ALTactileGesture, heard by the genuine `qi` library over a real socket."""

from __future__ import annotations

import time

import pytest

from helpers.still_nao import StillNao
from tci.robot.catalogue import load_robot


def test_gestures_are_told_as_on_a_real_nao() -> None:
    with StillNao(load_robot("nao-plain")) as nao:
        import qi

        from tci.wires.naoqi.tactile_gesture import ALTactileGesture

        served = ALTactileGesture(nao.services["ALMemory"])
        nao.session.registerService("ALTactileGesture", served)
        session = qi.Session()
        session.connect(f"tcp://127.0.0.1:{nao.port}")
        gestures, memory = session.service("ALTactileGesture"), session.service("ALMemory")
        heard: list[str] = []
        released: list[bool] = []
        gestures.onGesture.connect(heard.append)
        gestures.onRelease.connect(lambda: released.append(True))
        now = 0.0

        def told(*names: str) -> bool:
            """All gestures so far, each over before the next begins. Signals of one moment are two: `qi`
            delivers them in threads of their own, so either may come first."""
            end = time.monotonic() + 20.0
            while (len(heard), len(released)) != (len(names),) * 2 and time.monotonic() < end:
                time.sleep(0.01)
            return heard == [*names] and len(released) == len(names)

        def wait(seconds: float, **switches: float) -> None:
            nonlocal now
            for name, value in switches.items():
                memory.insertData(f"{name}TactilTouched", value)
            for _ in range(round(seconds / 0.02)):
                served._follow(now)
                now += 0.02

        assert gestures.getGestures()["CaressFtoR"] == ["000", "100", "010", "001", "000"]
        assert gestures.getGesture("000,111,000") == "SingleTap"
        assert gestures.createGesture(["000", "110", "000"]) == "gesture-060"
        with pytest.raises(RuntimeError, match="valid: 000, then states"):
            gestures.createGesture("100,000")
        wait(0.1, Front=1.0)
        wait(0.4, Front=0.0)
        assert told("SingleFront")
        assert memory.getData("ALTactileGesture/Gesture") == "SingleFront"
        wait(1.2)
        assert memory.getListData(["ALTactileGesture/Gesture"]) == [None]
        wait(0.9, Rear=1.0)
        memory.removeData("ALTactileGesture/Gesture")  # as any client may
        wait(0.4, Rear=0.0)
        assert told("SingleFront", "SingleRearHold")
        wait(0.1, Front=1.0, Middle=1.0)
        wait(0.4, Front=0.0, Middle=0.0)
        assert told("SingleFront", "SingleRearHold", "gesture-060")
        session.close()
