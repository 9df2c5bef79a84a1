"""One trial of a sweep: somebody touches a simulated robot somewhere, while a capability runs on it."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, lacks
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError
from tci.lab.sweeps.sweep import Result, Sweep, digest
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.runtime.arguments import load_capability
from tci.runtime.loop import Tick, run
from tci.runtime.result import MOVED
from tci.simulation.touching import people_for
from tci.touches.kinds import KINDS, kind_named
from tci.touches.person import Person
from tci.touches.planned_touch import PlannedTouch, plan
from tci.touches.touch import Touch

ONSET, AFTER = 0.4, 1.0
"""Time [s] before the touch, and after it."""
CONTACT = 0.02
"""Force [N] on a hand from which on it touches."""


@dataclass(frozen=True, slots=True)
class TouchTrials:
    """Touches of a robot by people who differ, any kind of `kinds` at any taxel. A trial depends on nothing
    but these fields and its number."""

    capability: str
    """As for `tci run`."""
    robot: str
    kinds: tuple[str, ...] = tuple(kind.name for kind in KINDS.values() if kind.generator != "none")
    patches: tuple[str, ...] = ()
    """Where the robot is touched; by default everywhere on its skin."""
    seed: int = 0

    def sweep(self, folder: Path, trials: int) -> Sweep:
        """The sweep over the trials 0 to `trials` - 1.

        Raises UnknownNameError for an unknown kind or patch, CommandError for a robot without skin or a
        capability that it lacks something for, and the errors of `load_robot` and `load_capability`.
        """
        robot, capability = load_robot(self.robot), load_capability(self.capability)
        for kind in self.kinds:
            kind_named(kind)
        for patch in self.patches:
            robot.patch(patch)
        if not robot.skin:
            raise CommandError(
                f"{robot.name} has no skin that could be touched; valid: tci robots lists them"
            )
        if missing := lacks(capability, robot):
            raise CommandError(f"{self.capability} on {robot.name}: {'; '.join(missing)}")
        of = digest(
            robot=robot.digest, capability=[self.capability, _written(self.capability, capability)],
            kinds=self.kinds, patches=self.patches, seed=self.seed,
        )  # fmt: skip
        return Sweep(folder, self, [(number,) for number in range(trials)], of)

    def __call__(self, number: int) -> Result:
        random = np.random.default_rng([self.seed, number])
        robot = load_robot(self.robot)
        body = GenericBody(robot)
        kind = str(random.choice(self.kinds))
        patch = str(random.choice(self.patches or [one.name for one in robot.skin]))
        taxel = int(random.integers(len(body.skin.surfaces[patch].positions)))
        person = Person.drawn(f"swept{random.integers(10**6)}")
        touch = Touch(kind, f"{patch} taxel {taxel}", ONSET, person=person.name)
        seed = int(random.integers(2**31))
        planned = plan(body, [touch], persons={person.name: person}, seed=seed)
        about = {
            "number": number, "kind": kind, "patch": patch, "taxel": taxel, "person": person.name,
            "asked_N": sum(one.peak for one in planned),
        }  # fmt: skip
        with SimulatedDriver(robot, people=people_for(planned), seed=seed) as driver:
            return {**about, **self._met(driver, planned)}

    def _met(self, driver: SimulatedDriver, planned: Sequence[PlannedTouch]) -> Result:
        """Touches, and tells what happened."""
        driver.world.touch_as_planned(planned)
        times, angles = list[float](), list[Array]()

        def see(tick: Tick) -> None:
            times.append(tick.now)
            angles.append(tick.reading.joints.position)

        end = max(one.end for one in planned) + AFTER
        result = run(driver, load_capability(self.capability), duration=end, observe=see)
        hands = [hand for person in driver.world.people for hand in person.hands]
        begun = min((one for hand in hands if (one := hand.first_contact) is not None), default=None)
        traces = [hand.trace[:, (0, 2)] for hand in hands]
        touched = [trace[trace[:, 1] > CONTACT, 0] for trace in traces]
        contact = [float(time[-1] - time[0]) for time in touched if len(time)]
        return {
            "hand_N": max((float(trace[:, 1].max()) for trace in traces if len(trace)), default=0.0),
            "contact_s": max(contact, default=0.0),
            "felt_N": max(result.touched.values(), default=0.0),
            "reaction_s": None if begun is None else _reaction(np.array(times), np.array(angles), begun),
            "moved_deg": float(np.degrees(max(result.moved.values(), default=0.0))),
            "refused": sum(one.count for one in result.refusals),
            "went_back": sum(one.count for one in result.went_back),
            "state": result.state.value,
            "no_room": "; ".join(reason for hand in hands for _, reason in hand.missed),
        }  # fmt: skip


def _reaction(times: Array, angles: Array, begun: float) -> float | None:
    """Time [s] from the first contact until a servo has turned by one degree; None if none does."""
    after = times >= begun
    if not after.any():
        return None
    turned = np.abs(angles[after] - angles[after][0]).max(axis=1) > MOVED
    return float(times[after][turned][0] - begun) if turned.any() else None


def _written(name: str, capability: Capability[Any]) -> str:
    """A digest of the file that says what a capability does."""
    file = Path(name) if Path(name).is_file() else Path(inspect.getsourcefile(type(capability)) or "")
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""
