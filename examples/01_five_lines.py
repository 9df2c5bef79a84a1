"""The withdrawal reflex on a simulated NAO: the whole program."""

import tci

robot = tci.load_robot("nao")
with tci.connect(robot, "sim") as link:
    tci.run(link, tci.WithdrawalReflex(), duration=1.0)
