"""A gentle arm presses whoever is in its way with no more than 10 N, and goes on when nobody is there."""

import numpy as np

import tci


class Lift(tci.Capability[bool]):
    """Swings the left arm forward, once."""

    def init(self, body: tci.GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[tci.GenericCommand, ...], bool]:
        target = body.robot.part("left_arm").initial_posture + np.array([0.5, 0.0, 0.0, 0.0, 0.0])
        return (() if memory else (tci.GenericCommand("left_arm", "position", target),)), True


def press(name: str) -> None:
    with tci.connect(name, "sim") as driver:
        finger, forces = driver.world.finger, list[tuple[float, float]]()
        finger.poke("left_forearm", 100, speed=0.1, depth=0.025)  # 20 N on an arm that keeps still

        def watch(tick: tci.Tick) -> None:
            forces.append((tick.now, finger.force))
            if tick.now > 3.0:
                finger.retire()

        result = tci.run(driver, tci.Gentle(Lift(), cap=10.0), duration=6.0, observe=watch)
        late = [force for now, force in forces if 1.5 < now < 3.0]
        print(f"{name}: at most {max(force for _, force in forces):.1f} N, later {max(late):.1f} N")
        print(f"  {result}")


press("nao")
press("g1")
