"""Complete program: runs the withdrawal reflex on a simulated NAO that is poked."""

import tci

with tci.connect("nao", "sim") as driver:
    driver.world.finger.poke("left_forearm", 150)
    print(tci.run(driver, tci.WithdrawalReflex(), duration=1.0))
