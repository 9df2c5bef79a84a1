"""What people mean by a touch: the robot tells each touch as a word."""

import tci
from tci.capabilities import Heard, TouchWords


def tell(name: str, *touches: str) -> None:
    words = TouchWords()
    body = tci.GenericBody(name)
    patch = body.robot.patches[0].name
    print(f"{name} knows on {patch}: {', '.join(words.words_on(patch, body))}")
    said: list[str] = []

    def listen(memory: Heard) -> bool:
        said.extend(words.notes(memory))
        return False

    with tci.connect(name, "sim", people=1) as driver:
        done = driver.world.touch(touches)
        end = done[-1].end + 1.5
        tci.run(driver, words, duration=end, until=listen)
    print("  " + "\n  ".join(said))


tell("g1", "stroke 'left forearm' 0.2..0.8", "squeeze 'left upper arm'", "pat 'right forearm'")
tell("nao-plain", "press 'top of head' 2N 0.3s", "tap 'back of left hand' 2N")
