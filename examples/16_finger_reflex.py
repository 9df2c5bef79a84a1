"""A hand lets go when a pad on one of its fingers is pressed."""

import numpy as np

import tci

INDEX = 3  # generic flexion of the index finger

reflex = tci.FingerReflex()
body = tci.GenericBody("g1-inspire")
hangs = {hand: reflex.relaxed(hand, body) for hand in body.parts("fingers")}

with tci.connect("g1-inspire", "sim", posture=hangs) as driver:
    driver.world.finger.poke("left_ring_top", 44, depth=0.008)
    bent = list[float]()

    def watch(tick: tci.Tick) -> None:
        bent.append(float(np.rad2deg(tick.perception.posture["left_fingers"][INDEX])))

    print(tci.run(driver, reflex, duration=0.6, observe=watch))
    print(f"the index finger beside it opens from {bent[0]:.0f} to {bent[-1]:.0f} degrees")
