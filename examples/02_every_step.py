"""The loop of `tci.run`, step by step. In addition, `run` handles the begin, faults, watchdogs and a safe
end."""

import tci

robot = tci.load_robot("nao")
body, reflex = tci.GenericBody(robot), tci.WithdrawalReflex()
with tci.connect(robot, "sim") as driver:
    driver.world.finger.poke("left_forearm", 100, speed=0.2, depth=0.008)
    perceiver, memory = tci.Perceiver(body), reflex.init(body)
    for now in driver.ticks(duration=1.0):
        reading = driver.read()
        perception = perceiver.step(reading, now)
        commands, memory = reflex.step(memory, perception, body)
        orders, refused = body.to_platform(commands, reading.joints)
        driver.write(driver.gate.step(orders, reading.joints, now, refused=refused))
        for command in commands:
            print(f"{now:.3f} s: {command.part} withdraws")
