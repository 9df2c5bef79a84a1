"""A hard poke, a light pat: the same robot flinches from one, and looks at the other."""

import tci
from tci.capabilities import ArbiterMemory, Companion

companion = Companion()
for name in ("nao", "icub"):
    for touch in ("poke 'left forearm' 20N", "pat 'right forearm' 2N"):
        said: list[str] = []

        def listen(memory: ArbiterMemory, said: list[str] = said) -> bool:
            said.extend(note for note in companion.notes(memory) if " holds " in note and note not in said)
            return False

        with tci.connect(name, "sim", people=1) as driver:
            driver.world.touch(touch)
            print(tci.run(driver, companion, duration=2.0, until=listen))
        print(f"  {touch}: {'; '.join(said)}")
