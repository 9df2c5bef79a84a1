"""A new capability on two robots: a touched arm is lifted to the side, and returns after the touch."""

from dataclasses import dataclass

import numpy as np

import tci


@dataclass(frozen=True)
class Shrug(tci.Capability[dict[str, tuple[np.ndarray, float]]]):
    """Lifts a touched arm to the side. The memory contains, for each touched arm, the posture before the
    touch [rad] and the time of the last touch [s]."""

    parts: tuple[str, ...] = ("left_arm", "right_arm")  # a contact may also be on NAO's head
    threshold: float = 0.5  # [N]
    lift: float = np.deg2rad(20.0)  # [rad] of shoulder roll
    wait: float = 0.4  # [s] after the last touch

    def init(self, body):
        return {}

    def step(self, memory, perception, body):
        memory, commands = dict(memory), []
        touched = {c.part for c in perception.contacts if c.part in self.parts and c.force > self.threshold}
        for part, posture in perception.posture.items():
            if part in touched:
                if part not in memory:
                    target = posture + np.array([0.0, self.lift, 0.0, 0.0, 0.0])
                    commands.append(tci.GenericCommand(part, tci.Mode.POSITION, target))
                memory[part] = memory.get(part, (posture,))[0], perception.stamp
            elif part in memory and perception.stamp - memory[part][1] > self.wait:
                commands.append(tci.GenericCommand(part, tci.Mode.POSITION, memory.pop(part)[0]))
        return tuple(commands), memory


if __name__ == "__main__":
    for name in ("nao", "icub"):
        robot = tci.load_robot(name)
        with tci.connect(robot, "sim") as driver:
            rolls: list[float] = []

            def watch(tick, world=driver.world, rolls=rolls):
                rolls.append(tick.perception.posture["left_arm"][1])
                if tick.now > 0.08:
                    world.finger.retire()

            driver.world.finger.poke("left_forearm", 100)
            tci.run(driver, Shrug(), duration=2.0, observe=watch)
            start, highest, end = np.rad2deg([rolls[0], max(rolls), rolls[-1]])
            print(f"{name}: shoulder roll {start:.0f}, then {highest:.0f}, then {end:.0f} degrees")
