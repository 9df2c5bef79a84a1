"""A robot for programs that know only numbers with names, such as those of LeRobot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.teach.capability import LEAD
from tci.capabilities.teach.guide import Feel, guided
from tci.capabilities.teach.limb import Limb, limbs_of
from tci.drivers.driver import Driver
from tci.drivers.registry import connect
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, TciError
from tci.learn.head_camera import Sees, head_camera
from tci.learn.names import Names
from tci.messages import ExpectContact, Order, Perception
from tci.messages.frames import Array
from tci.recording.recorder import Recorder
from tci.robot.like import RobotLike, as_robot
from tci.runtime.moment import Tick
from tci.runtime.stepper import Stepper
from tci.simulation.hand_path import APPROACH
from tci.simulation.touching import people_for
from tci.touches.person import Person
from tci.touches.planned_touch import plan
from tci.touches.touch import Touch, parse_touch

PAUSE = 1.0
"""Time [s] between two touches of a simulated person."""
STILL = 0.01
"""Speed [rad/s] below which an arm that nobody touches any more has come to rest."""


@dataclass
class Guided:
    """How hands guide one part."""

    limb: Limb
    rates: Array
    """Its speeds (n,) [rad/s]."""
    rest: Array
    """Where it stays (n,) [rad] while nobody guides it."""


@dataclass
class _People:
    """People who touch a simulated robot, one touch after the other, over and over."""

    touches: tuple[Touch, ...]
    driver: SimulatedDriver
    due: float = 0.0
    done: int = 0

    def go_on(self) -> None:
        world = self.driver.world
        if world.time < self.due:
            return
        seed, touch = self.done, self.touches[self.done % len(self.touches)]
        who = {touch.person: Person.drawn(touch.person, seed=seed)}
        (planned, *_) = world.touch(touch, persons=who, seed=seed)
        self.due = world.time + max(planned.onset, APPROACH) + planned.end - planned.onset + PAUSE
        self.done += 1


class NamedRobot:
    """Generic parts of a robot as numbers with names: `observe` gives them, `act` takes angles.

    It is a `Stepper` inside, so all that is ordered goes through the gate, and a robot with a clock of its
    own holds when the program stays away. Posture and actions are named `left_arm.elbow_flexion.pos` [rad],
    the same on every robot, so what was learned on one moves another.
    """

    def __init__(
        self,
        robot: RobotLike = "nao",
        via: str = "sim",
        *,
        arm: bool | None = None,
        parts: Iterable[str] = (),
        observations: Iterable[str] = ("posture", "velocity", "contacts"),
        rate: float = 30.0,
        touches: Iterable[str | Touch] = (),
        picture: tuple[int, int] | None = None,
        record: str = "",
        task: str = "",
        feel: Feel | None = None,
        most: float = 15.0,
    ) -> None:
        """Names everything; `connect` opens the robot.

        Args:
            robot: Robot, its name, or its file.
            via: Driver, as for `tci.connect`.
            arm: True to move a real robot; None arms only a simulated one.
            parts: Generic parts. Empty: all arms.
            observations: What is seen of each: of `OBSERVED`.
            rate: Observations per second.
            touches: Touches of a simulated person, such as `"push 'left forearm' 5N 0.9s"`, one after the
                other and over and over.
            picture: Width and height [pixels] of pictures of a simulated robot's head camera; `observe` gives
                them as `head`.
            record: File for a recording of everything, also of the raw frames of the skin.
            task: What the recording shows.
            feel: What an arm that is guided by hands feels like.
            most: Force [N] of one contact above which hands do not guide.

        Raises the errors of `load_robot`, and TciError for an unknown part or observation, a rate out of
        range, and touches of a robot that is not simulated.
        """
        self.robot = as_robot(robot)
        self.via, self.rate, self._arm = via, rate, arm
        self._record, self._task, self._feel, self._most = record, task, feel or Feel(), most
        if not 0.0 < rate < np.inf:
            raise TciError(f"rate {rate}; valid: above 0 and finite")
        self.body = GenericBody(self.robot)
        self._names = Names(self.body, parts, observations)
        self.parts = self._names.parts
        self.touches = tuple(parse_touch(one) if isinstance(one, str) else one for one in touches)
        for what, given in (("touches", self.touches), ("pictures", picture)):
            if given and via != "sim":
                raise TciError(f"{what} over {via}; valid: over sim, which simulates them")
        self._size = picture
        self.actions = self._names.actions
        """Names of the angles that `act` takes."""
        self.observed = self._names.observed
        """Names of the numbers that `observe` gives."""
        self.pictures = {} if picture is None else {"head": (picture[1], picture[0], 3)}
        """Shapes of the pictures that it gives, by name."""
        self._limbs = {name: limb for name, limb in limbs_of(self.body).items() if not limb.soft}
        self._stepper: Stepper | None = None

    @property
    def is_connected(self) -> bool:
        return self._stepper is not None

    @property
    def driver(self) -> Driver:
        """Raises DriverError if the robot is not connected."""
        return self._connected.driver

    @property
    def _connected(self) -> Stepper:
        if self._stepper is None:
            raise DriverError(f"{self.robot.name} is not connected; valid: after connect()")
        return self._stepper

    def connect(self) -> None:
        """Opens the robot. Raises the errors of `tci.connect`, and DriverError if it is open already."""
        if self._stepper is not None:
            raise DriverError(f"{self.robot.name} is connected already; valid: disconnect() first")
        options: dict[str, Any] = {}
        if self.touches:
            options["people"] = len(people_for(*(plan(self.body, one) for one in self.touches)))
        driver = connect(self.robot, self.via, arm=self._arm, **options)
        self._recorder: Recorder | None = None
        self._world = driver.world if isinstance(driver, SimulatedDriver) else None
        try:
            if self._record:
                about = {**driver.info.about, **({"task": self._task} if self._task else {})}
                self._recorder = Recorder(
                    self._record, self.robot, middleware=self.via.partition(":")[0], period=driver.period,
                    keep_alive=driver.info.keep_alive, about=about,
                )  # fmt: skip
            self._people = None
            if self.touches and isinstance(driver, SimulatedDriver):
                self._people = _People(self.touches, driver)
            self._picture: Sees | None = None
            if self._size is not None and isinstance(driver, SimulatedDriver):
                self._picture = head_camera(driver.world, self._size)
                self._picture(driver.read())  # the first one takes seconds
            self._stepper = Stepper(driver, period=1.0 / self.rate, see=self._see)
        except BaseException:
            self._close(driver)
            raise
        self._seen: Perception | None = None
        self._before: Perception | None = None
        self._guided = dict[str, Guided]()
        self._expected: tuple[Order, ...] = ()

    def _see(self, tick: Tick) -> None:
        if self._recorder is not None:
            touching = {} if self._world is None else self._world.touching()
            self._recorder.tick(tick.now, tick.reading, tick.commands, tick.sent, touching=touching)

    def disconnect(self) -> None:
        """Brings the robot to rest, and closes it. A second call has no effect."""
        if self._stepper is None:
            return
        stepper, self._stepper = self._stepper, None
        try:
            stepper.close()
        finally:
            self._close(stepper.driver)

    def _close(self, driver: Driver) -> None:
        try:
            driver.close()
        finally:
            if self._recorder is not None:
                self._recorder.close()

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.disconnect()

    def observe(self) -> dict[str, Any]:
        """What is seen now, 1 / `rate` after the last call; waits for it: numbers, and pictures (height,
        width, 3). Angles are in rad, velocities in rad/s, forces in N, areas in cm2.

        Raises the errors of `Stepper.observe`.
        """
        stepper = self._connected
        if self._people is not None:
            self._people.go_on()
        self._before, self._seen = self._seen, stepper.observe()
        values: dict[str, Any] = {**self._names.see(self._seen, self._before or self._seen)}
        if self._picture is not None:
            values["head"] = self._picture(stepper.driver.read())
        return values

    def _now(self) -> Perception:
        """What `observe` saw last."""
        if self._seen is None:
            self.observe()
        assert self._seen is not None
        return self._seen

    def act(self, values: Mapping[str, float]) -> dict[str, float]:
        """Orders angles [rad], by the names of `actions`, and returns the set-points that the gate sent now:
        it approaches the angles within the robot's limits.

        Raises TciError for names that are missing or unknown, and for a number that is not finite; then
        nothing is ordered.
        """
        stepper = self._connected
        wrong = sorted({*values} ^ {*self.actions})
        wrong += [name for name in self.actions if not wrong and not np.isfinite(values[name])]
        if wrong:
            names = ", ".join(self.actions)
            raise TciError(f"action: {', '.join(wrong)}; valid: one finite number for each of {names}")
        orders: list[Order] = [*self._expected, *self._names.order(values)]
        self._expected = ()
        sent = stepper.act(orders)
        reading = self._now().joints
        assert reading is not None
        position = np.array(reading.position)
        position[sent.servos] = sent.position
        maps = self.body.joint_maps
        return self._names.angles({part: maps[part].to_generic(position) for part in self.parts})

    def guide(self) -> dict[str, float]:
        """The action with which arms go where hands push their skin (as in `tci.Teach`), from what `observe`
        saw last; who is not touched stays where it is. The next `act` declares these contacts to the gate.

        Raises TciError if the robot has no arm that feels how hard it is pushed.
        """
        seen = self._now()
        own = [part for part in self.parts if part in self._limbs]
        if not own:
            valid = ", ".join(self._limbs) or "another robot"
            raise TciError(f"{self.robot.name}: hands can't guide {', '.join(self.parts)}; valid: {valid}")
        target, expected = dict(seen.posture), list[Order]()
        for part in own:
            pushed, target[part] = self._guide(part, seen)
            if pushed:
                expected.append(ExpectContact(part, self._most))
        self._expected = tuple(expected)
        return self._names.angles(target)

    def _guide(self, part: str, seen: Perception) -> tuple[bool, Array]:
        """Whether hands push a part, and where it goes (n,) [rad]."""
        here = seen.posture[part]
        state = self._guided.setdefault(part, Guided(self._limbs[part], np.zeros(len(here)), here))
        pushes = [one for one in seen.contacts if one.patch in state.limb.patches]
        if any(one.force > self._most for one in pushes):
            state.rates, state.rest = np.zeros(len(here)), here
            return True, here
        elapsed = 1.0 / self.rate
        state.rates = guided(self._feel, self._most, part, pushes, state.rates, elapsed, seen, self.body)
        if not pushes and np.abs(state.rates).max() < STILL:
            state.rates = np.zeros(len(here))
            return False, state.rest
        state.rest = here
        return bool(pushes), here + (elapsed + LEAD) * state.rates
