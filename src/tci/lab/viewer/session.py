"""Runs one robot in a separate thread: executes the control loop and a person's requests, and creates the
views for the page."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.places import Place
from tci.capabilities.capability import Capability, lacks
from tci.capabilities.wrapper import unwrapped
from tci.drivers.driver import Driver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError
from tci.gate.acceptance import fault_of_reading
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.lab.viewer.fields import fields_of
from tci.lab.viewer.labels import moves, touched, without_numbers
from tci.lab.viewer.real_time import RealTime
from tci.lab.viewer.rehearsal import Rehearsal
from tci.lab.viewer.steered import Steered
from tci.lab.viewer.touching import Touching
from tci.lab.viewer.view import History, View
from tci.messages import GenericCommand, Mode, Order, SwitchMode
from tci.reasons import Code, Reason, text_of
from tci.recording.recorder import Recorder
from tci.runtime.control import Control
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.runtime.result import AGAIN
from tci.simulation.finger import STIFFNESS

FRESH = 0.01
"""Smallest time [s] between two views. A view with a new event may follow earlier."""
IDLE = 0.02
"""Time [s] between two checks of a robot whose loop has ended. Assumed: shorter than the time between two
pictures."""
QUIET = 0.3
"""A touch or command is shown as a new event if the pause before it is longer than this time [s]. Assumed:
short interruptions of one touch last less."""
GAP = 0.01
"""Distance [m] from which the finger approaches. Assumed: large enough, so that a person can see the
approach."""
LEAVE, STAY = 0.3, 1.5
"""Times [s] after which the finger leaves the robot: LEAVE after the finger lost contact, or STAY after it
began to touch, whichever is earlier. Assumed: long enough for a person to see the touch."""


HOMEWARD = 1.0
"""Speed [rad/s] on the way to the initial posture. Assumed: slow enough for a person who stands there."""


class _Closed(Exception):
    """Raised to end the session: the loop then brings the robot to rest and returns."""


class Session:
    """A running robot, real or simulated. Any thread may call the methods."""

    def __init__(self, driver: Driver, capability: Capability[Any], *, about: dict[str, str]) -> None:
        """Stores `about`, facts that each recording will contain. `start` begins the control loop, and
        `close` ends the loop."""
        self.robot = driver.robot
        self._moving = [
            part for part in driver.robot.parts if any(one.servo is not None for one in part.servos)
        ]
        self._patches = [patch.name for patch in driver.robot.patches]
        self.driver = FaultInjector(driver, [])
        self.world = driver.world if isinstance(driver, SimulatedDriver) else None
        self.armed = driver.armed
        self.view: View | None = None
        """The latest view."""
        self.history = History()
        self.report = LoopReport()
        self.events: deque[tuple[float, str]] = deque(maxlen=50)
        """Events as text, with their time [s]."""
        self.ended = ""
        """Reason why the loop ended. The text is empty while the loop runs."""
        self.pace = 1.0
        """Speed of the simulation [simulated seconds per second]. The value is 0 during a pause. It has no
        effect on a real robot."""
        self.pokes = 0
        """Number of pokes that began."""
        self.recorder: Recorder | None = None
        self._about = dict(about)
        self.rehearsal: Rehearsal | None = None
        """The latest fault that a person injected."""
        self.fields = fields_of(capability)
        """Receptive fields of the behaviour. The tuple is empty if the behaviour has no fields on limbs."""
        self.runs = about.get("capability", type(unwrapped(capability)).__name__)
        """Name of the capability that runs."""
        self.memory: Any = None
        """Its latest memory."""
        self._steered = Steered(capability)
        self._next: Capability[Any] | None = None
        self._goes_home = False
        self._inbox: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._again, self._closing = threading.Event(), threading.Event()
        self._recording = threading.Lock()
        self._noted: dict[str, float] = {}
        self._notes: frozenset[str] = frozenset()
        self._real_time = RealTime()
        self._leave = np.inf
        self.touching = Touching(self.world) if self.world is not None and self.world.people else None
        """Hands that somebody moves on the page; None if this robot has no simulated people."""
        self._state: tuple[GateState, Reason | None] = (GateState.RUN, None)
        self._tell_lacks(capability)
        self._thread = threading.Thread(target=self._work, name=f"loop of {self.robot.name}", daemon=True)

    @property
    def loop_words(self) -> str:
        """Timing of the loop, as text."""
        if not self.armed:
            return "read-only: this viewer does not command it"
        work = 1e3 * self.report.work.quantile(0.5)
        return f"{self.report.ticks} periods, {self.report.overruns} overruns, {work:.2f} ms each"

    def start(self) -> None:
        """Starts the loop."""
        self._thread.start()

    def close(self) -> None:
        """Brings the robot to rest, ends the loop, and closes the recording and the driver."""
        self._closing.set()
        self._again.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=5.0)
        self.stop_recording()
        self.driver.close()

    def post(self, action: Callable[[], object]) -> None:
        """Runs an action between two periods, in the loop's thread. If the action raises an error, the page
        shows this error as an event."""
        self._inbox.put(action)

    def poke(self, place: Place, *, force: float, speed: float) -> None:
        """Presses the skin with the simulated finger. The largest force is `force` [N], and the finger
        approaches with `speed` [m/s].

        Raises CommandError if the robot is not simulated.
        """
        world = self.world
        if world is None:
            raise CommandError(
                f"{self.robot.name} is not simulated, so no finger can poke it; valid: --via sim"
            )

        def begin() -> None:
            world.finger.retire()
            depth = force / STIFFNESS
            world.finger.poke(place.patch, place.p_L, place.n_L, speed=speed, depth=depth, gap=GAP)
            self._leave = world.time + STAY + GAP / speed
            self.pokes += 1
            assumed = " (assumed skin)" * self.robot.patch(place.patch).assumed
            self.say(f"poke of {place.patch}{assumed}: up to {force:g} N at {speed:g} m/s")

        self.post(begin)

    def touch(self, finger: object, place: Place, *, force: float) -> None:
        """Has a simulated hand touch a place on the skin with `force` [N], or go there along the skin if the
        `finger` touches already.

        Raises CommandError if the robot is not simulated, or has no people who can touch it.
        """
        if self.touching is None:
            why = "not simulated" if self.world is None else "simulated without people"
            raise CommandError(f"{self.robot.name} is {why}, so no hand can touch it; valid: --via sim")
        self.post(partial(self.touching.aim, finger, place, force))

    def let_go(self, finger: object) -> None:
        """Lifts the hand of a `finger`, and tells the touch in the words of `tci run --touch`."""

        def lift() -> None:
            words = self.touching.lift(finger) if self.touching is not None else ""
            if words:
                self.say(words)

        self.post(lift)

    def run(self, name: str, capability: Capability[Any], *, home: bool = False) -> None:
        """Runs another capability, after the robot has come to rest. `home`: from its initial posture on."""
        self.runs, self._next, self._goes_home = name, capability, home
        if self.ended:
            self.reset()

    def people_do(self, touches: Sequence[str]) -> None:
        """Has simulated people do touches in the words of `tci run --touch`. Raises CommandError if the robot
        is not simulated."""
        world = self.world
        if world is None:
            raise CommandError(
                f"{self.robot.name} is not simulated, so no hand can touch it; valid: --via sim"
            )
        self.post(lambda: self.say(", ".join(one.touch.kind for one in world.touch(touches))))

    def move(self, part: str, posture: np.ndarray) -> None:
        """Moves a generic part to a posture (n,) [rad], through the gate."""
        self._steered.orders.put(GenericCommand(part, Mode.POSITION, np.array(posture, dtype=float)))

    def home(self) -> None:
        """Moves every part to its initial posture."""
        for part in self._moving:
            self.move(part.name, part.initial_posture)

    def inject(self, name: str, *, lasts: float) -> None:
        """Injects a fault now, for `lasts` [s]."""
        plan = FaultPlan(name, 0.0, lasts)
        self.rehearsal = rehearsal = Rehearsal(plan)

        def begin() -> None:
            self.driver.inject(plan)
            self.say(f"fault for {rehearsal.plan.lasts:g} s: {plan}")

        self.post(begin)

    def reset(self) -> None:
        """Leaves the state STOP. If the loop has ended, starts it again. An operator calls this."""
        gate = self.driver.gate
        if not self.ended:
            self.post(lambda: self._operate("reset", gate.reset))
        elif self._operate("reset", gate.reset):
            self._again.set()

    def free(self) -> None:
        """Moves every part that is in contact slowly away. An operator calls this."""
        self.post(lambda: self._operate("free", self.driver.gate.free))

    def _operate(self, verb: str, act: Callable[[], None]) -> bool:
        """Does what an operator asks for, and tells it; False if the gate refuses it."""
        try:
            act()
        except CommandError as error:
            self.say(f"{verb} is refused: {error}")
            return False
        self.say(f"{verb} by the operator")
        return True

    def record(self, path: Path) -> None:
        """Starts a recording. Raises the errors of `Recorder`."""
        about = {"recorded_by": "tci view", **self.driver.info.about, **self._about}
        middleware = self._about.get("middleware", "sim")
        self.recorder = Recorder(
            path,
            self.robot,
            middleware=middleware,
            period=self.driver.period,
            keep_alive=self.driver.info.keep_alive,
            about=about,
        )
        self.say(f"recording to {path}")

    def stop_recording(self) -> Recorder | None:
        """Closes the recording and returns its recorder, or None if there is no recording."""
        with self._recording:
            recorder, self.recorder = self.recorder, None
        if recorder is not None:
            recorder.close()
            self.say(f"recorded {recorder.path}: {recorder.failed or f'{recorder.ticks} periods'}")
        return recorder

    def say(self, words: str) -> None:
        """Adds the text `words` to the list of events on the page."""
        self.events.append((self.view.time if self.view else 0.0, words))

    def _work(self) -> None:
        while not self._closing.is_set():
            self.ended = ""
            self._change()
            self._real_time.forget()
            try:
                if self.armed:
                    run(
                        self.driver, self._steered, observe=self._see, until=self._tell_notes,
                        report=self.report,
                    )  # fmt: skip
                else:
                    self._watch()
            except _Closed:
                return
            except Exception as error:
                self._again.clear()
                self.ended = f"{type(error).__name__}: {error}"
                self.say(f"the loop ended: {self.ended}")
                if self.rehearsal is not None and not self.rehearsal.over:
                    self.rehearsal.end(self.ended)
                while not (self._closing.is_set() or self._again.wait(IDLE)):
                    if self.world is not None:
                        self.world.advance(self.world.time + IDLE * self.pace)

    def _watch(self) -> None:
        """Reads a robot and updates the page, without commanding the robot, until the session ends."""
        for moment in Control(self.driver, GenericBody(self.robot), write=False).periods():
            now, reading, perception = moment.now, moment.reading, moment.perceived()
            with self._recording:
                if self.recorder is not None:
                    self.recorder.tick(now, reading, perception=perception)
            assert perception.skin is not None  # a Perceiver always sets `skin`
            felt = perception.skin.by_patch(self._patches)
            fault = fault_of_reading(self.robot, reading.joints, now, self.driver.gate.stale_after)
            old = text_of(fault)
            self._publish(
                View(now, reading.joints, perception.posture, felt, perception.contacts, None, old, 0.0)
            )
            self._between(now)

    def _see(self, tick: Tick) -> None:
        with self._recording:
            if self.recorder is not None:
                touching = {} if self.world is None else self.world.touching()
                self.recorder.tick(
                    tick.now, tick.reading, tick.commands, tick.sent, tick.perception, touching
                )
        sent = tick.sent
        state = (sent.state, sent.reason)
        if state[0] is not self._state[0]:
            self.say(f"{sent.state.name}: {sent.reason or 'commands pass again'}")
        for refusal in sent.refusals:
            if not sent.reason:
                self.say(f"refused: {refusal}")
        for clamp in sent.clamped:
            if clamp.code is Code.CONTACT:
                self.say(f"{clamp}; {AGAIN}")
        self._rehearse(tick)
        self._tell_moves(tick)
        changed, self._state = state != self._state, state
        if not changed and self.view is not None and 0.0 <= tick.now - self.view.time < FRESH:
            self._between(tick.now)
            return
        self._publish(
            View(
                time=tick.now,
                joints=tick.reading.joints,
                posture=tick.perception.posture,
                pressure=tick.skin.by_patch(self._patches),
                contacts=tick.perception.contacts,
                state=sent.state,
                reason=text_of(sent.reason),
                response=float(np.abs(sent.velocity).max(initial=0.0)),
                finger=self.world.finger.pose if self.world and self._leave < np.inf else None,
                hands=self.touching.seen(tick.perception.contacts) if self.touching else (),
            )
        )
        self._between(tick.now)

    def _rehearse(self, tick: Tick) -> None:
        """Records the gate's answer to a fault that was injected on purpose, and adds an event to the page
        when the fault is over."""
        rehearsal = self.rehearsal
        if rehearsal is None or rehearsal.over:
            return
        active = any(plan.name == rehearsal.plan.name for plan in self.driver.active)
        rehearsal.see(tick.now, tick.sent, active=active)
        if rehearsal.over:
            self.say(rehearsal.words)

    def _tell_moves(self, tick: Tick) -> None:
        """Adds an event to the page if a patch is touched, or a part is commanded, for the first time after a
        pause."""
        for contact in tick.perception.contacts:
            if tick.now - self._noted.get(contact.patch, -np.inf) > QUIET:
                self.say(touched(contact, self.fields, self.robot.switches))
            self._noted[contact.patch] = tick.now
        for order in tick.commands:
            if isinstance(order, GenericCommand):
                if tick.now - self._noted.get(order.part, -np.inf) > QUIET:
                    self.say(moves(order.part, order.values))
                self._noted[order.part] = tick.now

    def _change(self) -> None:
        """Takes the capability that somebody chose. Another one may have left parts in other modes."""
        if self._next is None:
            return
        capability, self._next = self._next, None
        first: list[Order] = [SwitchMode(part.name, Mode.POSITION) for part in self._moving]
        if self._goes_home:
            first += [
                GenericCommand(part.name, Mode.POSITION, part.initial_posture, HOMEWARD)
                for part in self._moving
            ]
        self._steered = Steered(capability, first=first)
        self.fields, self.memory, self._notes = fields_of(capability), None, frozenset()
        self._about |= {"capability": self.runs, "settings": repr(capability)}
        self.say(f"runs {self.runs}")
        self._tell_lacks(capability)

    def _tell_lacks(self, capability: Capability[Any]) -> None:
        for words in lacks(capability, self.robot):
            self.say(f"{type(unwrapped(capability)).__name__}: {words}")

    def _tell_notes(self, memory: Any) -> bool:
        """Adds an event to the page for each note of the capability that comes up, such as the layer that
        holds a part. Ends the run when somebody chose another capability."""
        self.memory = memory
        notes = {without_numbers(note): note for note in self._steered.notes(memory)}
        for kind, note in notes.items():
            if kind not in self._notes:
                self.say(note)
        self._notes = frozenset(notes)
        return self._next is not None

    def _publish(self, view: View) -> None:
        self.view = view
        self.history.add(view)

    def _between(self, now: float) -> None:
        """Runs the actions that other threads have requested, and then waits until the next period begins."""
        self._take_finger_away()
        if self.touching is not None:
            self.touching.update()
        while True:
            self._serve_inbox()
            if self._closing.is_set():
                raise _Closed
            if self.world is None:
                return
            pace = self.pace  # The value is read only once, because another thread may change it.
            if pace > 0.0:
                break
            self._real_time.forget()
            time.sleep(IDLE)
        self._real_time.wait(now, pace)

    def _serve_inbox(self) -> None:
        while True:
            try:
                action = self._inbox.get_nowait()
            except Empty:
                return
            try:
                action()
            except TciError as error:
                self.say(str(error))

    def _take_finger_away(self) -> None:
        world = self.world
        if world is None or self._leave == np.inf:
            return
        lost = world.finger.contact_lost
        if world.time >= self._leave or (lost is not None and world.time - lost > LEAVE):
            world.finger.retire()
            self._leave = np.inf
