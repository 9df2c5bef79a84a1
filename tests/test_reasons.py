"""Reasons: the numbers of codes are stable, and no decision of the program depends on a text."""

from __future__ import annotations

import ast
import copy
import pickle
import sys
import threading
from pathlib import Path

import pytest

import tci
from tci.errors import CommandError, DescriptionError, Fault, MissingExtraError, TciError, UnknownNameError
from tci.reasons import NO_REASON, Code, Reason, ReasonCounter, number_of, reason_of, text_of

SOURCE = Path(tci.__file__).parent
NAMES = {"reason", "refusal", "fault", "halt", "why"}
"""Names of variables that contain a reason, in modules that import `Reason`."""
MATCHES = {"startswith", "endswith", "find", "index", "count", "search", "match", "fullmatch", "partition"}
"""Methods and functions that search for words in a text."""

NUMBERS = {
    "OTHER": 0,
    "JOINTS_STALE": 100, "JOINTS_MISFIT": 101, "JOINTS_REPEATED": 102, "TIME_WENT_BACK": 103,
    "FOLLOWING_ERROR": 200, "OPPOSED_MOTION": 201, "ENCODER_JUMPED": 202, "ENCODER_FROZEN": 203,
    "ENCODER_DISAGREES": 204, "SERVO_OFF": 205, "SERVO_MODE": 206,
    "PERIODS_MISSED": 300, "PROCESS_FROZEN": 301, "HEARTBEAT_MISSING": 302, "RUN_ENDED": 303,
    "PROGRAM_FAILED": 304,
    "CALLER_SILENT": 305,
    "SKIN_SILENT": 400, "SKIN_MISFIT": 401, "SKIN_BLIND": 402,
    "COMMAND_INVALID": 500, "UNKNOWN_NAME": 501, "GATE_CLOSED": 502, "WRONG_MODE": 503,
    "LIKELY_DEGREES": 504, "LIMITS_UNKNOWN": 505, "LIMITS_EXCEEDED": 506, "IN_MOTION": 507,
    "SELF_COLLISION": 508, "OUT_OF_REACH": 509, "NOT_ARMED": 510, "CLAMPED": 511,
    "SWITCHES_AT_REST": 512, "CONTACT": 513, "OVERTAKEN": 514,
    "OTHER_COMMANDER": 600, "COMMANDER_SILENT": 601, "COMMANDER_HOLDS": 602, "COMMANDER_LEFT": 603,
    "OWNER_HOLDS": 604, "OWNER_REFUSES": 605, "OWNER_SILENT": 606, "OWNER_RESTARTED": 607, "HALTED": 608,
    "MOVED_BY_ITSELF": 609, "ROBOT_REFUSES": 610,
    "MOVED_WRONG_WAY": 700, "MOVED_TOO_FAR": 701, "MOVED_ANOTHER": 702, "NOT_ARRIVED": 703,
}  # fmt: skip
"""Numbers that recordings and other versions of TCI contain. Lines may be added, but no line may be
changed."""


def test_a_code_keeps_its_number() -> None:
    assert {code.name: code.value for code in Code} == NUMBERS
    assert max(Code) < NO_REASON


def test_a_reason_survives_the_way_over_a_wire_a_pickle_and_a_copy() -> None:
    for reason in (Reason(Code.SKIN_BLIND, "blind"), Reason(Code.OTHER, ""), None):
        assert reason_of(number_of(reason), text_of(reason)) == reason
        assert pickle.loads(pickle.dumps(reason)) == copy.deepcopy(reason) == reason
    assert reason_of(60_000, "of a later version") == Reason(Code.OTHER, "of a later version")
    assert str(Reason(Code.OTHER, "words")) == "words"


def test_an_error_is_a_reason_with_its_code() -> None:
    assert CommandError("no").reason == Reason(Code.COMMAND_INVALID, "no")
    assert UnknownNameError("part", "tail", ["head"]).reason.code is Code.UNKNOWN_NAME
    moving = CommandError("it moves", code=Code.IN_MOTION)
    assert pickle.loads(pickle.dumps(moving)).reason == Reason(Code.IN_MOTION, "it moves")
    assert CommandError("no").code is Code.COMMAND_INVALID, "the class is as it was"
    assert TciError("bad").reason.code is Code.OTHER


def is_reason(node: ast.expr) -> bool:
    """Returns True if the name of an expression indicates that it is a reason or the text of a reason."""
    if isinstance(node, ast.Call):
        return ast.unparse(node.func) in ("str", "text_of") and any(map(is_reason, node.args))
    if isinstance(node, ast.Subscript):
        return isinstance(node.value, ast.Attribute) and node.value.attr == "refusals"
    if isinstance(node, ast.Attribute):
        return node.attr in NAMES or (node.attr == "text" and is_reason(node.value))
    return isinstance(node, ast.Name) and node.id in NAMES


def decisions(source: str) -> list[str]:
    """Returns the expressions of a module that search for words in a reason, or compare a whole reason."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            texts = any(map(is_reason, sides)) and not any(
                isinstance(one, ast.Constant) and one.value is None for one in sides
            )
            if texts and any(isinstance(op, ast.In | ast.NotIn | ast.Eq | ast.NotEq) for op in node.ops):
                found.append(ast.unparse(node))
        elif isinstance(node, ast.Call) and isinstance(func := node.func, ast.Attribute):
            looks = func.attr in MATCHES and any(map(is_reason, (func.value, *node.args)))
            found += [ast.unparse(node)] * looks
    return found


@pytest.mark.parametrize(
    "source",
    [
        "if 'commanded by' in commander.reason: stop()",
        "if 'wrong way' in reason: advise()",
        "if safe.reason.text == 'halted': go()",
        "if str(safe.reason).startswith('hold'): go()",
        "re.search('old', reason.text)",
        "halt = safe.reason if safe.reason != self._told else ''",
        "if 'degrees' in safe.refusals[0].text: convert()",
    ],
)
def test_the_scan_finds_a_decision_on_a_text(source: str) -> None:
    assert decisions(source)


@pytest.mark.parametrize(
    "source",
    [
        "if reason.code is Code.OTHER_COMMANDER: stop()",
        "if reason is not None and reason.code == Code.HALTED: stop()",
        "if reason is not self._stopped: log(reason.text)",
        "print(f'{state}: {reason}')",
    ],
)
def test_the_scan_lets_codes_pass(source: str) -> None:
    assert not decisions(source)


def test_no_decision_hangs_on_the_text_of_a_reason() -> None:
    sources = {path: path.read_text() for path in SOURCE.rglob("*.py")}
    known = {path: text for path, text in sources.items() if "Reason" in text and "tci.reasons" in text}
    assert len(known) > 25
    found = {str(path.relative_to(SOURCE)): decisions(text) for path, text in known.items()}
    assert {path: those for path, those in found.items() if those} == {}


def test_kinds_may_be_read_while_another_thread_counts() -> None:
    """As `Stepper.result` does beside its worker."""
    kinds = [Reason(Code.OTHER, f"{chr(97 + k // 10)}{chr(97 + k % 10)}") for k in range(90)]
    counters = [ReasonCounter() for _ in range(100)]

    def count() -> None:
        for counter in counters:
            for kind in kinds:
                counter.add(kind, 0.0)

    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        worker = threading.Thread(target=count)
        worker.start()
        for counter in counters:
            while len(counter.notices()) < len(kinds):
                assert worker.is_alive() or len(counter.counts) == len(kinds)
        worker.join()
    finally:
        sys.setswitchinterval(usual)


@pytest.mark.parametrize(
    "error",
    [
        DescriptionError("nao.xml", [Fault(3, "no link"), Fault(0, "no joint")]),
        UnknownNameError("part", "left_am", ["left_arm", "head"]),
        MissingExtraError("tci view", "viser", "pip install"),
        CommandError("too fast", code=Code.WRONG_MODE),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_cross_to_other_processes_whole(error: TciError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again), again.code) == (
        type(error), str(error), vars(error), error.code,
    )  # fmt: skip
