"""Withdraw first, then look: a reflex above attention to touch, on a robot with a neck and on one without."""

import tci
from tci.capabilities import ArbiterMemory


def touch(name: str) -> None:
    attend = tci.Attend()
    both = tci.Arbiter([tci.WithdrawalReflex(), attend])
    said: list[str] = []

    def listen(memory: ArbiterMemory) -> bool:
        said.extend(note for note in attend.notes(memory.layers[-1].memory) if note not in said)
        return False

    with tci.connect(name, "sim") as driver:
        driver.world.finger.poke("left_forearm", 100)
        print(tci.run(driver, both, duration=1.5, until=listen))
    print("  " + "\n  ".join(said))


touch("nao")
touch("g1")
