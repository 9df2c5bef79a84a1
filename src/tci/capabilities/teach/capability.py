"""Teach by touch: guide an arm, tap, and it repeats; what it does wrong is corrected by touch while it plays.

A limb with skin moves as its forces say (`guide`); one that has only switches gets soft while it is held, as
owners of a NAO know it. All that is touched gives way, at any time, and what nobody holds stays where it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from tci.body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.capabilities.teach.guide import Feel, guided
from tci.capabilities.teach.lesson import LONGEST as FULL
from tci.capabilities.teach.lesson import PAUSE, Lesson
from tci.capabilities.teach.limb import Limb, limbs_of
from tci.capabilities.teach.motion import Motion
from tci.capabilities.teach.taps import Touching
from tci.errors import TciError
from tci.gestures.gesture import Gesture, fit
from tci.messages import Contact, ExpectContact, GenericCommand, Mode, Order, Perception, SwitchMode
from tci.messages.frames import Array, read_only

MOST = (1.0, 30.0)
"""Least and greatest force [N] up to which a contact may be handled."""
SOLE = "foot"
"""Segment of the skin that carries a standing robot."""
STIFFLY = 6.0
"""Speed per distance from where a limb should be [1/s]. At double of it, readings that are 50 ms old make it
swing."""
FASTEST = 1.0
"""Speed [rad/s] with which a limb catches up with its motion at most."""
LEAD = 0.05
"""Time [s] by which a soft limb's targets are ahead: the gate plans to stop at each of them."""
LAG = 0.03
"""Time [s] by which a measured angle is behind the speed that it was told, by bus and servo: 0.01 to 0.05. A
motion that is compared with where it is now, not with where it was then, runs ahead, and past its end."""
SLOWLY = 0.3
"""Speed [rad/s] with which a tapped limb goes back to where it was."""
NEAR = float(np.deg2rad(2.0))
"""Angle [rad] within which a limb has come to where the motion begins."""
PATIENCE = 6.0
"""Time [s] after which a motion begins although something keeps a limb from its start."""
EASE = 0.15
"""Time [s] in which a motion gets its speed, at its begin and after a touch."""
FREE = 1.0
"""Time [s] without touch after which a limb that was pressed too hard is its own again: a withdrawal has come
to its end."""
FOLLOWS = float(np.deg2rad(0.5))
"""Angle [rad] by which a soft limb was led when its target goes along."""


class Doing(Enum):
    """What a taught robot does."""

    WAITS = "waits"
    """For hands, while and after they teach."""
    GOES = "goes"
    """To where the motion begins."""
    PLAYS = "plays"


@dataclass(frozen=True, slots=True, eq=False)
class Taught:
    """Memory of `Teach`."""

    limbs: Mapping[str, Limb]
    phase: Doing = Doing.WAITS
    stamp: float = np.nan
    """[s]"""
    since: float = 0.0
    """When the phase began, or the motion went on after a touch [s]."""
    touches: Mapping[str, Touching] = field(default_factory=dict)
    """Of parts that can't be led, by name: they are tapped."""
    lesson: Lesson = field(default_factory=Lesson)
    """The lesson that is being given."""
    motion: Motion | None = None
    """What was taught last."""
    played: float = 0.0
    """Time [s] of the motion."""
    said: tuple[str, ...] = ()

    @property
    def learns(self) -> bool:
        return bool(self.lesson.taught)


@dataclass(frozen=True)
class Teach(Capability[Taught]):
    """Learns a motion by touch and repeats it. Raises TciError for a setting out of range.

    - Hands that hold a limb for half a second or more guide it.
    - A tap on another part, or two taps anywhere, end the lesson: it repeats the motion. The same taps
      repeat it again.
    - A hand that holds a limb while it plays stops the motion and leads the limb elsewhere; let go, the
      motion goes on from there. Three taps take the newest of these corrections back.

    It declares the contact that it handles up to `most` and claims a limb while it is touched, taught or
    played, so it belongs above a reflex: `tci.Arbiter([tci.Teach(), tci.WithdrawalReflex()])`. A limb that is
    pressed harder belongs to the reflex until nobody touches it.
    """

    needs = (
        Need("skin on an arm, a hand or fingers, or switches on a head", ("arm", "hand", "fingers", "head")),
    )
    gesture: Gesture | None = None
    """A motion to begin with, from any robot, that touch corrects; None to be taught one."""
    feel: Feel = field(default_factory=Feel)
    """What a guided arm feels like."""
    most: float = 15.0
    """Force [N] of one contact up to which it handles it."""
    softness: float = 0.2
    """Stiffness of a held limb that has only switches, as a fraction of full stiffness (as `SoftHands`)."""
    approach: float = 0.15
    """Speed [m/s] of the hand on its way to where a motion begins."""

    def __post_init__(self) -> None:
        ranges = {"most": MOST, "softness": (0.0, 1.0), "approach": (0.01, 0.5)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise TciError(f"teach: {name} {getattr(self, name)}; valid: {least:g} to {most:g}")

    def init(self, body: GenericBody) -> Taught:
        """Raises CommandError for a gesture of which the robot has no part."""
        limbs = limbs_of(body)
        if self.gesture is None:
            return Taught(limbs)
        fitted = fit(body.robot, self.gesture).gesture
        known = {part: angles for part, angles in fitted.postures.items() if part in limbs}
        if not known:
            raise TciError(
                f"teach: a gesture of {', '.join(fitted.postures)}; valid: of {', '.join(limbs) or 'no part'}"
            )
        return Taught(limbs, motion=Motion(Gesture(fitted.times, known)))

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """The switch of all limbs to the mode in which they are led."""
        return tuple(
            SwitchMode(name, Mode.IMPEDANCE if limb.soft else Mode.VELOCITY)
            for name, limb in limbs_of(body).items()
        )

    def step(
        self, memory: Taught, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Taught]:
        now = perception.stamp
        elapsed = min(max(now - memory.stamp, 0.0), 0.1) if memory.stamp == memory.stamp else 0.0
        places = {**{name: limb.touch for name, limb in memory.limbs.items()}, **memory.touches}
        series = {place: count for place, touch in places.items() if (count := touch.over(now))}
        pushed = self._pushed(memory, perception)
        before = memory.limbs
        memory = self._feel(replace(memory, stamp=now, said=()), pushed, perception)
        memory = _learn(memory, perception, elapsed)
        for place, count in series.items():
            memory = _tapped(memory, place, count)
        memory = _play(memory, before, perception, elapsed)
        orders, limbs = list[Order](), dict(memory.limbs)
        for name, limb in memory.limbs.items():
            given, limbs[name] = self._move(name, limb, memory, pushed[name], elapsed, perception, body)
            orders += given
        return tuple(orders), replace(memory, limbs=limbs)

    def claims(self, memory: Taught) -> frozenset[str]:
        """Limbs that are touched, taught or played, until they are pressed too hard."""
        return frozenset(name for name, limb in memory.limbs.items() if limb.rest is not None)

    def notes(self, memory: Taught) -> tuple[str, ...]:
        """What it does, and what to do next."""
        return memory.said

    def _pushed(self, memory: Taught, perception: Perception) -> dict[str, list[Contact]]:
        """The contacts by limb, or by other part or patch, also the lightest, to which a reflex below may
        answer."""
        limb_of = {patch: name for name, limb in memory.limbs.items() for patch in limb.patches}
        found: dict[str, list[Contact]] = {name: [] for name in memory.limbs}
        for one in perception.contacts:
            if one.segment != SOLE:
                other = one.patch if one.part in memory.limbs else one.part
                found.setdefault(limb_of.get(one.patch, other), []).append(one)
        return found

    def _feel(self, memory: Taught, pushed: Mapping[str, list[Contact]], perception: Perception) -> Taught:
        """How everything is touched now, and which limbs were pressed too hard."""
        limbs, said = dict[str, Limb](), list[str]()
        for name, limb in memory.limbs.items():
            grip = name in memory.lesson.taught or (memory.motion is None and not memory.learns)
            touch = limb.touch.feel(bool(pushed[name]), perception.stamp, grip=grip)
            force = max((one.force for one in pushed[name]), default=0.0)
            free = not touch.touched and perception.stamp - touch.felt > FREE
            let_go = force > self.most or (limb.let_go and not free)
            began = touch.touched and not limb.touch.touched
            before = perception.posture[name] if began else limb.before
            limbs[name] = replace(limb, touch=touch, let_go=let_go, before=before)
            if let_go:
                said.append(
                    f"{name} was pressed with more than {self.most:g} N: it is not guided until it is free"
                )
        others = {*memory.touches, *pushed} - {*limbs}
        touches = {
            name: memory.touches.get(name, Touching()).feel(name in pushed, perception.stamp)
            for name in others
        }
        return replace(memory, limbs=limbs, touches=touches, said=tuple(said))

    def _move(
        self, name: str, limb: Limb, memory: Taught, contacts: list[Contact], elapsed: float,
        perception: Perception, body: GenericBody,
    ) -> tuple[tuple[Order, ...], Limb]:  # fmt: skip
        """A limb's orders."""
        here, motion = perception.posture[name], memory.motion
        plays = memory.phase is not Doing.WAITS and motion is not None and name in motion.parts
        ours = plays or limb.touch.touched or limb.touch.taps > 0 or name in memory.lesson.taught
        if limb.let_go or not (ours or limb.yields):
            return (), replace(limb, rest=None, rates=read_only(np.zeros(here.size)))
        rest = limb.rest
        if rest is None:
            rest = limb.before if limb.touched else here
        if limb.touched:
            rest = here if limb.touch.held and not limb.soft else rest
        elif limb.touch.held and limb.rates.any() and not limb.soft:
            rest = here  # it comes to rest
        target, rates, speed = rest, np.zeros(here.size), SLOWLY
        if plays and motion is not None:
            target, speed = motion.at(memory.played)[name], FASTEST
            if memory.phase is Doing.GOES:
                speed = self.approach / _reach(name, body)
            elif not _stands(memory):
                if not limb.soft:
                    target = motion.at(max(memory.played - LAG, 0.0))[name]
                rates = _pace(memory) * motion.rates(memory.played)[name]
        if limb.soft:
            return self._lead(name, replace(limb, rest=rest), target + LEAD * rates, speed, here)
        if limb.touched:
            after = guided(self.feel, self.most, name, contacts, limb.rates, elapsed, perception, body)
        else:
            back = STIFFLY * (target - here)
            after = read_only(rates + back * min(1.0, speed / max(float(np.abs(back).max()), 1e-9)))
        orders = GenericCommand(name, Mode.VELOCITY, after), ExpectContact(name, self.most)
        return orders, replace(limb, rest=rest, rates=after if limb.touched else read_only(0.0 * after))

    def _lead(
        self, name: str, limb: Limb, target: Array, speed: float, here: Array
    ) -> tuple[tuple[Order, ...], Limb]:
        """Orders to a limb that gets soft while it is held."""
        if limb.touched:
            orders = list[Order]()
            if not limb.yields:
                orders.append(_stiffness(name, here.size, self.softness))
            if not limb.yields or limb.rest is None or np.abs(here - limb.rest).max() > FOLLOWS:
                orders.append(GenericCommand(name, Mode.IMPEDANCE, here))
                limb = replace(limb, rest=here)
            return tuple(orders), replace(limb, yields=True)
        if limb.yields:
            rest = limb.rest if limb.touch.held else limb.before
            assert rest is not None
            orders = [_stiffness(name, here.size, 1.0), GenericCommand(name, Mode.IMPEDANCE, rest)]
            return tuple(orders), replace(limb, rest=rest, yields=False)
        return (GenericCommand(name, Mode.IMPEDANCE, read_only(target), speed),), limb


def _learn(memory: Taught, perception: Perception, elapsed: float) -> Taught:
    """The lesson with this instant's posture.

    Also that of a guided limb that is now pressed too hard: what it does under the hand is what it is shown.
    """
    if memory.phase is not Doing.WAITS:
        return memory
    limbs, now = memory.limbs, perception.stamp
    held = frozenset(
        name for name, limb in limbs.items()
        if limb.touch.held and (limb.touched or (limb.touch.touched and name in memory.lesson.taught))
    )  # fmt: skip
    touched = any(limb.touched or now - limb.touch.felt < PAUSE for limb in limbs.values())
    lesson = memory.lesson.watch(perception.posture, limbs, held, elapsed, touched=touched)
    if not lesson.taught and not touched:
        lesson = Lesson()
    said = list(memory.said)
    taught = ", ".join(sorted(lesson.taught))
    if lesson.full:
        said.append(f"{taught}: the lesson is full, tap to repeat it; valid: up to {FULL:g} s")
    elif led := sorted(name for name in held if limbs[name].touched):
        said.append(f"{', '.join(led)}: guided, {lesson.clock:.0f} s")
    elif lesson.taught:
        said.append(f"{taught}: taught; tap another part once, or any part twice, to repeat it")
    return replace(memory, lesson=lesson, said=tuple(said))


def _tapped(memory: Taught, place: str, count: int) -> Taught:
    """What taps ask for."""
    motion, learns = memory.motion, memory.learns
    own = memory.lesson.taught if learns else frozenset(() if motion is None else motion.parts)
    if place in own and count == 1:
        return memory
    if learns:
        try:
            motion = memory.lesson.motion()
        except TciError as error:
            return replace(memory, lesson=Lesson(), said=(*memory.said, str(error)))
    elif motion is None:
        return memory
    elif count >= 3 and motion.corrections:
        motion = motion.undone()
    return replace(memory, motion=motion, lesson=Lesson(), phase=Doing.GOES, since=memory.stamp, played=0.0)


def _play(memory: Taught, before: Mapping[str, Limb], perception: Perception, elapsed: float) -> Taught:
    """The motion after this instant."""
    motion, now = memory.motion, perception.stamp
    if memory.phase is Doing.WAITS or motion is None:
        return memory
    own = {part: memory.limbs[part] for part in motion.parts}
    if any(limb.let_go for limb in own.values()):
        return replace(memory, phase=Doing.WAITS)
    words = f"{', '.join(motion.parts)}: "
    if any(one.part in own and one.answer in ("soft", "retreat", "stop") for one in perception.met):
        said = f"{words}gave way to somebody in the way; tap again to repeat the motion"
        return replace(memory, phase=Doing.WAITS, said=(*memory.said, said))
    if _stands(memory):
        held = ", ".join(part for part, limb in own.items() if limb.touched)
        return replace(
            memory, since=now, said=(*memory.said, f"{words}waits, since {held} is held; let go, it goes on")
        )
    if memory.phase is Doing.GOES:
        there = all(np.abs(perception.posture[part] - a).max() < NEAR for part, a in motion.at(0.0).items())
        if there or now - memory.since > PATIENCE:
            return replace(memory, phase=Doing.PLAYS, since=now)
        return replace(memory, said=(*memory.said, f"{words}goes to where the motion begins"))
    for part, limb in own.items():
        if before[part].touched and limb.touch.held:
            motion = motion.corrected(part, min(memory.played, motion.duration), perception.posture[part])
    if memory.played >= motion.duration + EASE:  # it has come to rest there
        return replace(memory, motion=motion, phase=Doing.WAITS)
    said = f"{words}repeats {min(memory.played, motion.duration):.1f} of {motion.duration:.1f} s"
    if motion.corrections:
        said += f", corrected {len(motion.corrections)} times (three taps take the last one back)"
    played = memory.played + _pace(memory) * elapsed
    return replace(memory, motion=motion, played=played, said=(*memory.said, said))


def _stands(memory: Taught) -> bool:
    """True while somebody touches what moves."""
    motion = memory.motion
    return motion is not None and any(memory.limbs[part].touch.touched for part in motion.parts)


def _pace(memory: Taught) -> float:
    return min(1.0, (memory.stamp - memory.since) / EASE)


def _stiffness(limb: str, joints: int, share: float) -> GenericCommand:
    return GenericCommand(limb, Mode.STIFFNESS, read_only(np.full(joints, share)))


def _reach(name: str, body: GenericBody) -> float:
    """Length [m] of a limb; a head's is small."""
    return sum(one.length for one in body.robot.part(name).segments) or 0.3
