"""A person guides a G1's arm and taps its other arm: it repeats the motion, and so does an iCub."""

import tci
from tci.capabilities import ArbiterMemory, Taught
from tci.gestures import Gesture


def teach(name: str) -> Gesture:
    said: list[str] = []
    capability = tci.Teach()

    def listen(memory: ArbiterMemory) -> bool:
        said.extend(note for note in capability.notes(memory.layers[0].memory) if note not in said)
        return False

    with tci.connect(name, "sim", people=1) as driver:
        driver.world.touch(["push 'left forearm' 5N 0.9s", "tap 'right forearm'"])
        layers = tci.Arbiter([capability, tci.WithdrawalReflex()])
        result = tci.run(driver, layers, duration=5.0, until=listen)
    print(result)
    print("  " + "\n  ".join(said[1:4]))
    memory: Taught = result.memory.layers[0].memory
    assert memory.motion is not None
    return memory.motion.gesture(tci.GenericBody(name))


def repeat(name: str, gesture: Gesture) -> None:
    with tci.connect(name, "sim", people=1) as driver:
        driver.world.touch("tap 'right forearm'")
        print(tci.run(driver, tci.Teach(gesture=gesture), duration=4.0))


repeat("icub", teach("g1"))
