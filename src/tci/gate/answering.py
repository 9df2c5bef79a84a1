"""How a gate answers contact, in each of its states, or leaves that to another gate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tci.errors import CommandError
from tci.gate.acceptance import check_command
from tci.gate.contact.group import Way
from tci.gate.contact.reaction import ContactReaction
from tci.gate.contact.settings import ContactSettings
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.gate.motion import Motion
from tci.messages import Contacts, JointReading, Met, PlatformOrder, PlatformSwitch
from tci.messages.commands import MOST_EXPECTED
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.joint_calibration import Tool

UNFIT = frozenset(
    {
        Code.OPPOSED_MOTION, Code.ENCODER_JUMPED, Code.ENCODER_FROZEN, Code.ENCODER_DISAGREES, Code.SERVO_OFF,
        Code.SERVO_MODE, Code.JOINTS_REPEATED,
    }
)  # fmt: skip
"""Causes of a stop after which no way back is known: angles or servos are not what they seem."""
ANSWERED = ("retreat", "stop")
"""Answers of another gate that are told. A part that "soft" gives way rests and obeys, usually."""
POWER = frozenset({Code.SERVO_OFF, Code.SERVO_MODE})
"""Those after which the gate sends no stiffness: it might switch on a servo that somebody switched off."""


class Answering:
    """Answers contact of one robot; without settings another gate does, and nothing is done here."""

    def __init__(self, robot: Robot, settings: ContactSettings | None) -> None:
        self._robot, self._loads = robot, dict[str, Tool]()
        self._reaction = None if settings is None else self._make(settings)
        self._told_met: tuple[Met, ...] = ()
        self._news: list[Reason] = []
        self.told: list[Reason] = []
        """What to tell of the latest step."""
        self._fresh = frozenset[int]()

    def _make(self, settings: ContactSettings) -> ContactReaction:
        made = ContactReaction(self._robot, groups_of(self._robot), settings)
        made.load(self._loads)
        return made

    def _own(self) -> ContactReaction:
        if self._reaction is None:
            raise CommandError("this gate does not answer contact; valid: the gate that owns the robot")
        return self._reaction

    def load(self, loads: Mapping[str, Tool]) -> None:
        """Sets what links carry, by the name of the link."""
        self._loads = dict(loads)
        if self._reaction is not None:
            self._reaction.load(self._loads)

    def change(self, settings: ContactSettings) -> None:
        """See `Gate.set_contact`."""
        before = self._own()
        if self.met or before.blocked:
            raise CommandError("a part is in contact; valid: other settings when nothing presses")
        self._reaction = self._make(settings)
        self._reaction.sag_as(before)

    @property
    def met(self) -> tuple[Met, ...]:
        """Contacts that were noticed in the last step, and parts that obey nobody yet, here or by the gate
        that answers them."""
        return self._told_met if self._reaction is None else self._reaction.met + self._reaction.waiting

    def tell_met(self, met: Sequence[Met]) -> None:
        """Says what the gate that answers contact noticed. What it began to answer is told, too."""
        if self._reaction is not None:
            return
        before = {one.part for one in self._told_met if one.answer in (*ANSWERED, "waits")}
        new: dict[Met, list[str]] = {}
        for one in met:
            if one.answer in ANSWERED and one.part not in before:
                new.setdefault(replace(one, part=""), []).append(one.part)
        self._news += [
            Reason(Code.CONTACT, str(replace(one, part=" and ".join(parts)))) for one, parts in new.items()
        ]
        self._told_met = tuple(met)

    @property
    def torques_tell(self) -> bool:
        """Measured torques of the latest reading tell of contact."""
        return self._reaction is not None and self._reaction.torques_tell

    @property
    def touched(self) -> tuple[str, ...]:
        """Names of the parts that are still in contact."""
        return () if self._reaction is None else self._reaction.touched

    @property
    def blocked(self) -> frozenset[int]:
        """Servos that a contact moves now."""
        return frozenset() if self._reaction is None else self._reaction.blocked

    @property
    def disobey(self) -> frozenset[int]:
        """Servos that obey nobody now, since their part leaves a contact or waits for one that does."""
        return frozenset() if self._reaction is None else self._reaction.blocked | self._reaction.waits

    @property
    def excused(self) -> frozenset[int]:
        """Servos that a contact moves, that somebody leads, or whose motors lack torque, now: they need not
        follow."""
        own = self._reaction
        return frozenset() if own is None else own.blocked | own.led | own.overshoots

    @property
    def lags(self) -> Array | None:
        """Time (n_servos,) [s] by which each joint lags at most that nothing holds; None if nobody measures
        it here."""
        return None if self._reaction is None else self._reaction.lags

    @property
    def stays(self) -> frozenset[int] | None:
        """Servos that must not move while others leave a contact; None if nobody knows here."""
        return None if self._reaction is None else self._reaction.stays

    def free(self, stopped: Reason | None) -> None:
        """See `Gate.free`."""
        own = self._own()
        if stopped is not None and stopped.code in UNFIT:
            raise CommandError(f"no way is known: {stopped}; valid: free the person by hand")
        if not own.met:
            raise CommandError("nothing is in contact; valid: free while a part met something")
        own.free()

    def forget(self) -> None:
        """The servos are under command no more."""
        if self._reaction is not None:
            self._reaction.forget()

    def expect(self, order: PlatformOrder, now: float) -> None:
        """Notes a capability's declaration. Raises CommandError if it is invalid."""
        if isinstance(order, PlatformSwitch):
            raise CommandError("a switch to expected contact; valid: an ExpectContact", code=Code.WRONG_MODE)
        declared = check_command(self._robot, order)
        force = float(declared.values.max())
        if not (declared.values >= 0.0).all() or force > MOST_EXPECTED:
            raise CommandError(f"expected contact of {force} N; valid: 0 to {MOST_EXPECTED:g} N")
        if self._reaction is not None:
            self._reaction.expect(declared.servos, force, now)

    def overtakes(self, order: PlatformOrder, joints: JointReading, now: float) -> Reason | None:
        """Why an order must not pass that came in the instant in which its servos began to obey nobody; None
        if it may. Raises CommandError if it came later and must not pass."""
        why = None if self._reaction is None else self._reaction.refuses(order, joints.position, now)
        if why is None:
            return None
        if self._fresh.isdisjoint(np.ravel(order.servos).tolist()):
            raise CommandError(why, code=Code.CONTACT)
        return Reason(Code.OVERTAKEN, f"an order came at that instant: {why}")

    def closed(self, order: PlatformOrder, now: float) -> None:
        """Notes an order that did not pass for another cause."""
        if self._reaction is not None:
            self._reaction.closed(order, now)

    def accepted(self, order: PlatformOrder, now: float) -> None:
        """Notes that an order passed."""
        if self._reaction is not None:
            self._reaction.accepted(order, now)

    def step(
        self,
        motion: Motion,
        joints: JointReading,
        reference: Reference,
        now: float,
        contacts: Contacts | None,
        stopped: Reason | None,
        *,
        blind: bool,
        held: Reason | None,
    ) -> tuple[Sequence[Way], Reason | None]:
        """Judges contacts, unless it is `blind`, without usable joint data; returns where servos must go,
        also in the state STOP, and why to stop. A person is freed whatever the cause of the stop, unless
        the joint data can't be trusted: then, and after a reset, the stiffness changes. No part gets it back
        while the robot holds for a reason, `held`."""
        unfit = stopped is not None and stopped.code in UNFIT
        if blind and not unfit:
            return (), None
        self.told, self._fresh, before = [], frozenset(), self.disobey
        if self._reaction is None:
            self.told, self._news = self._news, []
            return (), None
        if stopped is not None and unfit:
            if stopped.code not in POWER:
                shares, self.told = self._reaction.ease(contacts, joints, now)
                motion.soften(shares)
            self._reaction.forget()
            return (), None
        ways, self.told = self._reaction.step(joints, reference, now, contacts)
        self._fresh = self.disobey - before
        motion.soften(self._reaction.softer)
        reason = self._reaction.reason
        if stopped is None and reason is None and held is None:
            motion.soften(self._reaction.give_back(joints, reference.servos, now))
        return ways, reason
