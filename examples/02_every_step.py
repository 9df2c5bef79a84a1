"""The same loop with every step in sight, and a finger that pokes the simulated forearm."""

import tci

robot = tci.load_robot("nao")
reflex = tci.WithdrawalReflex()
with tci.connect(robot, "sim") as driver:
    driver.world.finger.poke("left_forearm", 100, speed=0.2, depth=0.008)
    body, memory = tci.GenericBody(robot), reflex.init()
    for now in driver.ticks(duration=1.0):
        reading = driver.read()
        seen = body.perceive(reading, now)
        commands, memory = reflex.step(memory, seen)
        platform = body.to_platform(commands, reading.joints)
        sent = driver.write(driver.gate.step(platform, reading.joints, now))
        for command in commands:
            print(f"{now:.3f} s: {command.part} withdraws")
