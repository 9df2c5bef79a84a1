"""Attention to touch: the robot looks where it is touched, and follows a stroke.

It withdraws first and looks then, which is what people preferred with NAO and Pepper (54 people, arXiv
2209.00414): it waits until the parts that a layer above has taken are at rest. A robot without a neck turns
its waist, while nobody touches what the waist carries along: turning would press it into the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tci.body import PEOPLE, GenericBody, Look, Struck
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.errors import TciError
from tci.messages import Contact, GenericCommand, Mode, Order, Perception
from tci.messages.frames import Array, read_only
from tci.robot.blow import checked_people

STILL = 0.1
"""Speed [rad/s] of its joints below which a part has withdrawn: 3 % of the peak of a slow withdrawal."""
SMOOTH = 0.1
"""Time constant [s] of the estimated speed of a touch. Half of it follows the noise of the centre of
pressure, double of it lags behind a rub."""
FRESH = np.deg2rad(0.5)
"""Angle [rad] by which a target must change to be commanded anew: nobody sees less."""
LONG = 3.0
"""Multiple of `FRESH` within which a joint has come to its target, and of `patience` after which it never
will."""
BESIDE = np.deg2rad(2.0)
"""Angle [rad] from which on it is told that the limits keep the gaze from the touch."""
HAND = 0.03
"""Distance [m] from a touched place at which a turn of the waist keeps skin: a finger and 20 mm."""
TOUCH = 1e-3
"""Rounding [m] of such a distance."""
SOLE = "foot"
"""Segment of the skin that carries a standing robot."""
NOWHERE = read_only(np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Attention:
    """What a robot attends to: the memory of `Attend`."""

    touch: int = -1
    """Identity of the touch; -1 for none."""
    part: str = ""
    """Touched part."""
    force: float = 0.0
    """Largest force [N] of the touch so far."""
    onset: float = 0.0
    """[s]"""
    felt: float = -np.inf
    """When it was last felt [s]."""
    place: Array = field(default_factory=NOWHERE.view)
    """Where it was last felt (3,) [m], in the torso frame."""
    speed: Array = field(default_factory=NOWHERE.view)
    """How it moves (3,) [m/s], in the torso frame."""
    look: Look | None = None
    """What it last looked at; None before it has looked."""
    turns: str = ""
    """What turned; empty while it is where it was."""
    home: Array | None = None
    """Generic angles (n,) [rad] to which the gaze returns; None while it is there."""
    way: float = -np.inf
    """When the gaze was last on its way to the touch [s]."""
    left: float = np.inf
    """When it began to return [s]."""
    held: bool = False
    """True if the look was stopped because somebody touches what it would move."""
    blocked: float = -np.inf
    """When somebody last touched what it would move [s]."""
    taken: frozenset[str] = frozenset()
    """Parts that layers above hold."""
    said: str = ""


@dataclass(frozen=True)
class Attend(Capability[Attention]):
    """Looks at the newest touch. Raises TciError for a setting out of range.

    It moves only the head, or the waist of a robot without a neck, so it belongs below a reflex:
    `tci.Arbiter([tci.WithdrawalReflex(), tci.Attend()])`.
    """

    needs = (
        Need("skin on any part"),
        Need("head or torso", ("head", "torso"), skin=False),
    )
    threshold: float = 0.5
    """Smallest force [N] of a touch that draws attention. Assumed: a light finger."""
    delay: float = 0.1
    """Time [s] from the onset of a touch to the look. A reflex above has then begun to move; people look at a
    touch after 0.2 to 0.3 s."""
    lead: float = 0.12
    """Time [s] by which the gaze aims ahead of a moving touch, since a joint reaches a new target that much
    later."""
    patience: float = 2.0
    """Time [s] for which it goes on looking after the touch, and after it has come there. Assumed."""
    quiet: float = 0.5
    """Time [s] without touch of what it would move after which a look begins, or goes on. Assumed: a hand
    that pats, slides or shakes makes contact again within this time, and one that leaves is out of the
    way."""
    people: Sequence[Struck] = PEOPLE
    """Who may stand in the way of head and arms, as for `WithdrawalReflex`; empty for the full speed."""

    def __post_init__(self) -> None:
        for name in ("threshold", "delay", "lead", "patience", "quiet"):
            least = 0.0 if name in ("delay", "lead") else np.nextafter(0.0, 1.0)
            if not least <= getattr(self, name) < np.inf:
                valid = "0 or more" if least == 0.0 else "above 0"
                raise TciError(f"attend: {name} {getattr(self, name)}; valid: {valid}, finite")
        object.__setattr__(self, "people", checked_people("attend", self.people))

    def init(self, body: GenericBody) -> Attention:
        return Attention()

    def step(
        self, memory: Attention, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Attention]:
        """A command to the head or the torso when its target changes."""
        part, now = body.turns_gaze, perception.stamp
        if not all(np.isfinite(angles).all() for angles in perception.posture.values()):
            return (), memory  # nobody knows where the touch is, and the gate holds
        memory = self._feel(memory, perception, body)
        if not part or (memory.touch < 0 and memory.home is None):
            return (), memory
        carried = body.carried(part)
        touched = dict.fromkeys(one.part for one in perception.contacts if one.patch in carried)
        # what no skin feels, the gate notices at the joints
        touched |= dict.fromkeys(
            one.part for one in perception.met if one.part == part and one.answer != "waits"
        )
        if touched:
            return self._hold(replace(memory, blocked=now), perception, part, tuple(touched))
        if any(one.part == part for one in perception.met):  # the gate dropped its order, which is due again
            said = f"{part} waits, since another part met somebody"
            return (), replace(memory, look=None, left=np.inf, blocked=now, said=said)
        if now - memory.blocked < self.quiet:
            return (), memory
        here = perception.posture[part]
        if memory.look is not None and np.abs(memory.look.target - here).max() > LONG * FRESH:
            memory = replace(memory, way=now)
        # what is blocked never comes there
        if now - max(memory.felt, min(memory.way, memory.felt + LONG * self.patience)) > self.patience:
            return self._return(memory, perception, body, part)
        if now < memory.onset + self.delay or self._withdraws(memory, perception, body):
            return (), replace(memory, said=f"{memory.part} is touched; it may withdraw before {part} looks")
        new = memory.look is None or memory.felt == now
        look, why = memory.look, ""
        if look is None or new:
            look, why = self._look(memory, perception, body)
        last = None if memory.held or memory.look is None else memory.look.target
        if last is not None and np.abs(look.target - last).max() < FRESH:
            return (), memory
        home = here if memory.home is None else memory.home
        said = f"{part} looks at {memory.part}, which is touched with {memory.force:.1f} N"
        if look.left > BESIDE:
            said += f"; it stays {np.rad2deg(look.left):.0f} degrees beside it{why}"
        memory = replace(memory, look=look, turns=part, home=home, held=False, left=np.inf, said=said)
        return (self._go(look.target, perception, body, part),), memory

    def claims(self, memory: Attention) -> frozenset[str]:
        """What looks, from the first look until it is back."""
        return frozenset({memory.turns} if memory.turns else ())

    def pause(
        self, memory: Attention, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Attention]:
        return (), replace(memory, taken=taken)

    def resume(
        self,
        memory: Attention,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], Attention]:
        return last, replace(memory, taken=taken)

    def notes(self, memory: Attention) -> tuple[str, ...]:
        """What it looks at, or why it doesn't."""
        return (memory.said,) if memory.said else ()

    def _feel(self, memory: Attention, perception: Perception, body: GenericBody) -> Attention:
        """The memory with the newest touch, as it is felt now."""
        part, now = body.turns_gaze, perception.stamp
        unseen = body.carried(part) if body.parts("head") == (part,) else frozenset()
        touches = [
            one
            for one in perception.contacts
            if one.force >= self.threshold and one.segment != SOLE and one.patch not in unseen
        ]
        own = [one for one in perception.contacts if one.identity == memory.touch]
        if touches:
            newest = max(touches, key=lambda one: (one.onset, one.force, one.identity))
            if newest.identity != memory.touch and not (own and newest.onset <= memory.onset):
                return self._begin(memory, newest, now, body)
        if not own:
            return memory
        if not part:
            return replace(memory, felt=now)
        one = own[0]
        elapsed = now - memory.felt
        speed = memory.speed
        if elapsed > 0.0:
            share = 1.0 - np.exp(-elapsed / SMOOTH)
            speed = read_only(speed + share * ((one.p_T - memory.place) / elapsed - speed))
        force = max(memory.force, one.force)
        return replace(memory, felt=now, place=one.p_T, speed=speed, force=force)

    def _begin(self, memory: Attention, touch: Contact, now: float, body: GenericBody) -> Attention:
        said = "" if body.turns_gaze else f"{touch.part} is touched; it has no neck and no waist to look with"
        # a hand that slides or pats makes contact anew
        again = memory.part == touch.part and now - memory.felt < self.delay
        speed = memory.speed if again else NOWHERE
        onset = memory.onset if again else now
        return replace(
            memory, touch=touch.identity, part=touch.part, force=touch.force, onset=onset, felt=now,
            place=touch.p_T, speed=speed, said=said, look=memory.look if again else None,
        )  # fmt: skip

    def _withdraws(self, memory: Attention, perception: Perception, body: GenericBody) -> bool:
        """True while a part moves that a layer above has taken."""
        return any(
            np.abs(body.rate(perception, part)).max(initial=0.0) > STILL
            for part in memory.taken
            if part != body.turns_gaze and part in perception.posture
        )

    def _look(self, memory: Attention, perception: Perception, body: GenericBody) -> tuple[Look, str]:
        """How to look there, and why it would stay beside it."""
        ahead = self.lead * memory.speed if memory.felt == perception.stamp else 0.0
        look = body.look_at(perception, memory.place + ahead)
        if body.robot.part(look.part).kind == "head":
            return look, ", since its joints go no farther"
        # the waist takes the arms along: not back to the hand that they have just left
        apart = body.nearest(perception, look.part, look.target, memory.place)
        free = np.minimum.accumulate(apart) >= min(HAND, apart[0] - TOUCH)
        share = float(np.flatnonzero(free)[-1]) / (len(apart) - 1)
        here = perception.posture[look.part]
        left = look.left + (1.0 - share) * look.off
        look = replace(look, target=read_only(here + share * (look.target - here)), left=left)
        return look, ": farther would take an arm back to the hand"

    def _hold(
        self, memory: Attention, perception: Perception, part: str, touched: tuple[str, ...]
    ) -> tuple[tuple[Order, ...], Attention]:
        """Stops a look, or a return, that would move what somebody touches."""
        said = f"{part} keeps still: it would move {', '.join(touched)}, which is touched"
        if memory.held or memory.home is None:
            return (), replace(memory, held=memory.home is not None, said=said)
        here = perception.posture[part]
        return (GenericCommand(part, Mode.POSITION, here),), replace(memory, held=True, said=said)

    def _return(
        self, memory: Attention, perception: Perception, body: GenericBody, part: str
    ) -> tuple[tuple[Order, ...], Attention]:
        """The way back to where the gaze was, and the end of it."""
        now, home = perception.stamp, memory.home
        if home is None:
            return (), replace(memory, touch=-1, look=None, said="")
        if np.isinf(memory.left) or memory.held:
            order = self._go(home, perception, body, part)
            return (order,), replace(memory, left=now, held=False, said=f"{part} returns: nobody touches")
        near = np.abs(home - perception.posture[part]).max() < LONG * FRESH
        if near or now - memory.left > self.patience:
            return (), Attention(taken=memory.taken)
        return (), memory

    def _go(self, target: Array, perception: Perception, body: GenericBody, part: str) -> GenericCommand:
        pace = body.pace(perception, part, target, self.people)
        return GenericCommand(part, Mode.POSITION, target, speed=pace.speed)
