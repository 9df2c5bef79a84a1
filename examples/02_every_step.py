"""The same loop with every step in sight, and a finger that pokes the simulated forearm."""

import tci

robot = tci.load_robot("nao")
reflex = tci.WithdrawalReflex()
with tci.connect(robot, "sim") as link:
    link.world.finger.poke("left_forearm", 100, speed=0.2, depth=0.008)
    skin, memory = tci.Skin(robot), reflex.init()
    for now in link.ticks(duration=1.0):
        reading = link.read()
        posture = tci.generic_posture(robot, reading.joints)
        contacts = tci.find_contacts(skin, skin.update(reading), posture)
        seen = tci.Perception(now, posture, contacts)
        commands, memory = reflex.step(memory, seen)
        platform = [tci.to_platform(robot, command) for command in commands]
        sent = link.write(link.gate.step(platform, reading.joints, now))
        for command in commands:
            print(f"{now:.3f} s: {command.part} withdraws")
