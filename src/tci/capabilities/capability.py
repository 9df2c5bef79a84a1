"""The base class of capabilities, with frozen settings and an explicit memory (Fig. 2, L4)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from inspect import isfunction, signature
from typing import Any, ClassVar, Generic, Self, TypeVar

from tci.body.generic_body import GenericBody
from tci.capabilities.needs import Need
from tci.errors import TciError
from tci.messages import Order, Perception
from tci.reasons import Reason
from tci.robot.like import RobotLike, as_robot

Memory = TypeVar("Memory")


class Capability(ABC, Generic[Memory]):
    """A behaviour that uses only the generic body. So the behaviour is independent of robot, clock and
    middleware.

    The object contains only frozen settings. All state is in the memory: the caller passes the memory to each
    step, and the step returns the next memory. If memory and perception are equal, the commands must be equal
    bit for bit, so that recordings can be replayed.
    """

    wrong: ClassVar[str] = ""
    """What is wrong with the class; empty if nothing is."""

    @property
    def needs(self) -> tuple[Need, ...]:
        """What it needs of a robot, so that a robot without it is told before the run instead of "nothing
        moved". A subclass states it as data: `needs = (Need("skin on an arm", ("arm",)),)`.
        """
        return ()

    def __init_subclass__(cls, **options: Any) -> None:
        """Notes a method that takes other arguments than the method of this class. The error comes when
        the class is used, so that one wrong class leaves the others of its module usable."""
        super().__init_subclass__(**options)
        cls.wrong = ""
        for name in ("init", "begin", "step", "claims", "pause", "resume", "notes", "fault"):
            own, declared = getattr(cls, name), signature(getattr(Capability, name)).parameters
            if not isfunction(own):
                continue
            try:
                signature(own).bind(*declared)
            except TypeError:
                cls.wrong = (
                    f"{cls.__name__}.{name}({', '.join(signature(own).parameters)}) has other arguments than "
                    f"a capability; valid: def {name}({', '.join(declared)})"
                )

    def __new__(cls, *settings: Any, **named: Any) -> Self:
        """Raises TciError if a method of the class takes other arguments than a capability's."""
        if cls.wrong:
            raise TciError(cls.wrong)
        return super().__new__(cls)

    @abstractmethod
    def init(self, body: GenericBody) -> Memory:
        """Returns the memory for the first step."""

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """Returns the orders to execute once before the first step, such as switches of the control mode.

        By default there are no orders. If the robot refuses one of these orders, the capability is not run.
        """
        return ()

    @abstractmethod
    def step(
        self, memory: Memory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        """Returns the commands for this instant, and the memory for the next step. Changes no argument.

        Return a command only if the target changes. If there is no new command, the gate (the safety filter
        before the driver) continues the motion to the last target.

        Contacts may be on any part of the robot, for example on the switches of NAO's head. Use only contacts
        with a `part` that your behaviour moves, and ignore the others. Read the angles of a part
        with `perception.posture.get("left_arm")`, which returns None if the robot lacks this part.
        """

    def claims(self, memory: Memory) -> frozenset[str]:
        """Generic parts that it holds now, for an `Arbiter`: while a layer claims a part, the layers below
        can't move it. Only the last layer of an `Arbiter` may leave this method out.
        """
        return frozenset()

    def pause(
        self, memory: Memory, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        """Called when layers above take more parts; `taken` is all that they hold now, its own or not. `step`
        follows in the same instant, and goes on as before: its commands to these parts are dropped.
        """
        return (), memory

    def resume(
        self,
        memory: Memory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], Memory]:
        """Called when layers above give parts back, before the `step` of the same instant.

        Args:
            memory: Its memory.
            taken: Parts that layers above still hold.
            last: What brings the returned parts back to where it left them: its last position order to each.
                A velocity or torque is never repeated; in its place stands the switch to that mode. By
                default these orders are returned.
            perception: What is felt now.
            body: The robot's body.
        """
        return last, memory

    def notes(self, memory: Memory) -> tuple[str, ...]:
        """Returns messages for a person, such as the reason why a touched part does not move."""
        return ()

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns a reason to stop the robot, or None if there is no reason.

        Example of a reason: the skin that this behaviour needs sends no data.
        """
        return None


def lacks(capability: Capability[Any], robot: RobotLike) -> tuple[str, ...]:
    """What a robot lacks for a capability, such as `no skin on an arm of this robot`; empty if it has all."""
    robot = as_robot(robot)
    return tuple(
        dict.fromkeys(f"no {need.what} of this robot" for need in capability.needs if not need.met(robot))
    )
