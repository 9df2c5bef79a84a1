"""Capabilities that wrap another capability report its faults and notes, so that a reflex without healthy
skin stops the robot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.touches import BODY, body_that, see
from tci.body.generic_body import GenericBody
from tci.capabilities.arbiter import Arbiter
from tci.capabilities.behaviour_tree import BehaviourTree, Reflex
from tci.capabilities.body_withdrawal import BodyMemory, BodyWithdrawal
from tci.capabilities.capability import Capability
from tci.capabilities.contact_stop import ContactStop
from tci.capabilities.play_gesture import PlayGesture
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.capabilities.withdrawal_memory import Refusal
from tci.capabilities.wrapper import CapabilityWrapper, unwrapped
from tci.errors import CommandError
from tci.gestures.gesture import Gesture, fit
from tci.lab.viewer.steered import Steered
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.robot.catalogue import load_robot
from tci.testing import perception

T = np.linspace(0.0, 1.0, 21)
STILL = Gesture(T, {"left_arm": np.deg2rad(np.array([25.0, 25, 0, 60, 0]) + np.zeros((21, 1)))})

SKIN = perception("nao").skin
MASKED = replace(see(), skin=replace(SKIN, masked=np.ones(1, bool)))
BLIND = body_that(coverage=lambda perception, part, places, radius: np.zeros(len(places)))
"""A body whose fields contain no healthy taxel."""


class Refusing(BodyWithdrawal):
    """A reflex that reports a refusal from the beginning."""

    def init(self, body: GenericBody) -> BodyMemory:
        return BodyMemory({}, {"left_leg": Refusal("it carries", b"", 0.0)})

    def step(
        self, memory: BodyMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], BodyMemory]:
        return (), memory


class Nod(Capability[dict[str, int]]):
    """Returns a single command instead of a tuple. Its memory is empty, like the memory of a reflex at
    rest."""

    def init(self, body: GenericBody) -> dict[str, int]:
        return {}

    def begin(self, perception: Perception, body: GenericBody) -> Any:
        return SwitchMode("head", Mode.POSITION)

    def step(self, memory: dict[str, int], perception: Perception, body: GenericBody) -> Any:
        return GenericCommand("head", Mode.POSITION, np.zeros(3)), memory


class Sleepy(Nod):
    """Returns None instead of commands and memory."""

    def step(self, memory: dict[str, int], perception: Perception, body: GenericBody) -> Any:
        return None


def wrapped(reflex: Capability[Any]) -> dict[str, Capability[Any]]:
    return {
        "nothing changed": CapabilityWrapper(reflex),
        "contact stop": ContactStop(reflex),
        "arbiter": Arbiter([WithdrawalReflex(), reflex]),
        "tree": BehaviourTree(lambda: Reflex("away", reflex)),
        "steered": Steered(reflex),
        "one in another": ContactStop(Steered(reflex)),
    }


@pytest.mark.parametrize("name", wrapped(WithdrawalReflex()))
def test_a_blind_field_is_a_fault_of_what_runs_the_reflex(name: str) -> None:
    reflex = WithdrawalReflex()
    capability = wrapped(reflex)[name]
    assert "is blind: 0%" in str(reflex.fault(MASKED, BLIND))
    assert capability.fault(MASKED, BLIND) == reflex.fault(MASKED, BLIND)
    assert capability.fault(see(), BODY) is None


@pytest.mark.parametrize("name", wrapped(Refusing()))
def test_notes_are_those_of_the_reflex(name: str) -> None:
    capability = wrapped(Refusing())[name]
    _, memory = capability.step(capability.init(BODY), see(), BODY)
    assert capability.notes(memory) == ("left_leg was touched and does not move: it carries",)


class Told(Capability[tuple[str, ...]]):
    """Its memory lists the calls that it got."""

    def init(self, body: GenericBody) -> tuple[str, ...]:
        return ()

    def step(self, memory: tuple[str, ...], perception: Perception, body: GenericBody) -> Any:
        return (), (*memory, "step")

    def claims(self, memory: tuple[str, ...]) -> frozenset[str]:
        return frozenset(memory)

    def pause(self, memory: tuple[str, ...], taken: frozenset[str], *seen: Any) -> Any:
        return SwitchMode("head", Mode.POSITION), (*memory, f"pause {sorted(taken)}")

    def resume(self, memory: tuple[str, ...], taken: frozenset[str], last: Any, *seen: Any) -> Any:
        return last, (*memory, f"resume {sorted(taken)}")


@pytest.mark.parametrize("wrap", [CapabilityWrapper, ContactStop, Steered])
def test_a_wrapper_forwards_what_an_arbiter_asks_and_tells(wrap: Any) -> None:
    told = Told()
    wrapper = wrap(wrap(told))
    assert unwrapped(wrapper) is told
    memory = wrapper.init(BODY)
    paused, memory = wrapper.pause(memory, frozenset({"left_arm"}), see(), BODY)
    assert [order.part for order in paused] == ["head"]
    _, memory = wrapper.step(memory, see(), BODY)
    again = (GenericCommand("left_arm", Mode.POSITION, np.zeros(5)),)
    resumed, memory = wrapper.resume(memory, frozenset(), again, see(), BODY)
    assert resumed == again
    assert wrapper.claims(memory) == {"pause ['left_arm']", "step", "resume []"}


def test_a_gesture_without_a_reflex_needs_no_skin() -> None:
    play = PlayGesture(fit(load_robot("icub"), STILL))
    assert play.fault(MASKED, BLIND) is None
    assert play.notes(play.init(BODY)) == ()


@pytest.mark.parametrize("name", wrapped(Nod()))
def test_one_command_of_what_runs_inside_counts_as_a_tuple_of_one(name: str) -> None:
    capability = wrapped(Nod())[name]
    (begun,) = capability.begin(see(), BODY)
    assert isinstance(begun, SwitchMode)
    assert begun.part == "head"
    commands, _ = capability.step(capability.init(BODY), see(), BODY)
    assert [command.part for command in commands if isinstance(command, GenericCommand)][:1] == ["head"]


@pytest.mark.parametrize("name", wrapped(Sleepy()))
def test_what_is_no_answer_is_refused_by_the_name_of_what_gave_it(name: str) -> None:
    capability = wrapped(Sleepy())[name]
    with pytest.raises(CommandError, match="Sleepy: step returned NoneType; valid: the pair"):
        capability.step(capability.init(BODY), see(), BODY)
