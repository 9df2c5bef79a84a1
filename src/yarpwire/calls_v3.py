"""Calls to a served control board in the form of YARP 3.12, such as `[get] [encs]` or `[set] [pos] 0
12.5`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from yarpwire.board import Stream
from yarpwire.board_service import BoardService
from yarpwire.errors import CallError, YarpError
from yarpwire.values import Vocab

PROTOCOL = (1, 9, 0)
"""Protocol version that control boards of YARP 3.12 report."""
OK, FAIL, IS = Vocab("ok"), Vocab("fail"), Vocab("is")
Words = Sequence[Any]
USAGE = {
    "[help]": "list usage",
    "[help] [more]": "list usage with some comments",
    "[get] [prot]": "get the version of the protocol",
    "[get] [axes]": "get the number of axes",
    "[get] [name] $iAxisNumber": "get the name of an axis",
    "[get] [llim] $iAxisNumber": "get the lowest and highest angle of an axis",
    "[get] [encs]": "get the angles of all axes",
    "[get] [enc] $iAxisNumber": "get the angle of an axis",
    "[get] [icmd] [cmod] $iAxisNumber": "get the control mode of an axis",
    "[get] [dons]": "get 1 if all moves are done, else 0",
    "[set] [icmd] [cmod] $iAxisNumber [pos]": "set the control mode of an axis",
    "[set] [vel] $iAxisNumber $fSpeed": "set the speed of the moves of an axis",
    "[set] [pos] $iAxisNumber $fPosition": "move an axis to an angle",
    "[set] [poss] ($fPosition ...)": "move all axes to angles",
    "[set] [vmos] ($fVelocity ...)": "move all axes at velocities",
    "[set] [stos]": "stop all axes",
}
"""Calls that `[help]` lists, each with its purpose."""


def answer_v3(board: BoardService, items: Words) -> list[Any]:
    """Returns the answer to a call in the form of YARP 3.12. The answer to an unknown or impossible call is
    `[fail]`."""
    words = [item.word if isinstance(item, Vocab) else item for item in items]
    try:
        if words[:2] == ["get", "prot"]:
            return [Vocab("prot"), *PROTOCOL, OK]
        if words[:1] == ["set"]:
            with board.awaited():
                _set(board, words[1], words[2:])
            return [OK]
        if words[:1] != ["get"]:
            return _explain(words[1:]) if words[:1] == ["help"] else [FAIL]
        found = _get(board, words[1], words[2:])
    except (YarpError, ArithmeticError, LookupError, TypeError, ValueError):
        return [FAIL]
    board.counter += 1
    return [*found, Vocab("tsta"), board.counter - 1, board.stamp, OK]


def _explain(words: Words) -> list[Any]:
    """Returns the answer to `help`: all calls. For `help more`, each call is followed by its purpose."""
    if words == ["more"]:
        return [Vocab("many"), *(line for call, purpose in USAGE.items() for line in (call, f"   {purpose}"))]
    return [Vocab("many"), *USAGE]


def _set(board: BoardService, word: str, rest: Words) -> None:
    if word == "icmd":
        _set_words(rest, {"cmod": 1, "cmog": 2, "cmds": 3}, board.set_modes)
    elif word == "intm":
        _set_words(rest, {"mode": 1, "modg": 2, "mods": 3}, board.set_interactions)
    elif word == "iimp" and rest[0] == "ipr":
        board.set_impedance(rest[1], rest[2][0], rest[2][1])
    elif word == "torq" and rest[0] in ("ref", "refs"):
        one = rest[0] == "ref"
        board.stream(Stream.TORQUE, [rest[1]] if one else None, [rest[2]] if one else rest[1])
    elif word == "vmos":
        board.stream(Stream.VELOCITY, None, rest[0])
    elif word in ("sto", "stos", "stog"):
        board.stop({"sto": rest[:1], "stos": None, "stog": rest[1] if len(rest) > 1 else []}[word])
    else:
        stem, kind = (word[:-1], word[-1]) if word[-1] in "sg" and len(word) == 4 else (word, "")
        joints, values = _targets(kind, rest)
        if stem in ("pos", "rel"):
            board.move(joints, values, relative=stem == "rel")
        elif stem in ("vel", "acc"):
            (board.set_speeds if stem == "vel" else board.set_accelerations)(joints, values)
        else:
            raise CallError(f"[set] [{word}] is not known")


def _targets(kind: str, rest: Words) -> tuple[Sequence[int] | None, Sequence[float]]:
    """Returns the joints (None: all joints) and the values in a call. `kind` is `s` for all joints, `g` for
    some joints, and empty for one joint. `rest` are the arguments of the call."""
    if kind == "s":
        return None, rest[0]
    return (rest[1], rest[2]) if kind == "g" else ([rest[0]], [rest[1]])


def _set_words(
    rest: Words, kinds: dict[str, int], act: Callable[[Sequence[int] | None, Sequence[int]], None]
) -> None:
    match kinds[rest[0]]:
        case 1:
            act([rest[1]], [rest[2]])
        case 2:
            act(rest[2], rest[3])
        case _:
            act(None, rest[1])


def _get(board: BoardService, word: str, rest: Words) -> list[Any]:
    head = [IS, Vocab(word)]
    state = board.state
    if word == "icmd" or word == "intm":
        return _get_words(board, word, rest)
    if word == "iimp":
        joint = board.joints([rest[1]])[0]
        if rest[0] == "ipr":
            return [*head, board.impedance(joint).tolist()]
        if rest[0] == "llim":
            return [*head, [x for most in board.impedance_limits(joint) for x in (0.0, most)]]
        raise KeyError(rest[0])
    if word == "torq":
        return [*head, *_torque(board, rest)]
    if word == "reca" and list(rest) == ["isca"]:
        return [*head, 0]  # no calibrator: a served robot is always ready
    one = {"enc": state.position, "esp": state.velocity, "vel": board.speeds, "acc": board.accelerations,
           "eac": np.zeros(board.count), "pos": board.set_points[Stream.POSITION],
           "dpo": board.set_points[Stream.POSITION], "vmo": board.set_points[Stream.VELOCITY]}  # fmt: skip
    if word in one:
        return [*head, float(_array(one[word])[board.joints([rest[0]])[0]])]
    if word[:-1] in one and word[-1] in "sg":
        chosen = None if word[-1] == "s" else rest[1]
        return [*head, _array(one[word[:-1]])[board.joints(chosen)].tolist()]
    joint = board.joints([rest[0]])[0] if rest and isinstance(rest[0], int) else 0
    match word:
        case "axes":
            return [*head, board.count]
        case "name":
            return [*head, board.name(rest[0])]
        case "type":
            return [*head, int(Vocab("atrv"))]
        case "llim":
            return [*head, *board.limits(joint)]
        case "vlim":
            return [*head, 0.0, board.speed_limit(joint)]
        case "don":
            return [*head, int(board.is_done([rest[0]]))]
        case "dons":
            return [*head, int(board.is_done(None))]
        case "dong":
            return [*head, int(board.is_done(rest[1]))]
    raise KeyError(word)


def _get_words(board: BoardService, word: str, rest: Words) -> list[Any]:
    modes = board.state.modes if word == "icmd" else board.state.interactions
    words = [Vocab(mode) for mode in modes or ()]
    head = [IS, Vocab(rest[0])] if word == "icmd" else []
    if rest[0] in ("cmod", "mode"):
        joint = board.joints([rest[1]])[0]
        return [IS, joint, words[joint]] if word == "icmd" else [words[joint]]
    if rest[0] in ("cmog", "modg"):
        return [*head, [words[joint] for joint in board.joints(rest[2])]]
    return [*head, words]


def _torque(board: BoardService, rest: Words) -> list[Any]:
    torque = board.state.torque
    match rest[0]:
        case "trq":
            return [float(_array(torque)[board.joints([rest[1]])[0]])]
        case "trqs":
            return [_array(torque).tolist()]
        case "ref":
            return [float(board.set_points[Stream.TORQUE][board.joints([rest[1]])[0]])]
        case "refs":
            return [board.set_points[Stream.TORQUE].tolist()]
        case "rng":
            most = board.torque_limit(rest[1])
            return [-most, most]
        case "rngs":
            most_all = [board.torque_limit(joint) for joint in range(board.count)]
            return [[-most for most in most_all], most_all]
    raise KeyError(rest[0])


def _array(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    if values is None:
        raise CallError("the robot does not measure it")
    return np.asarray(values, dtype=float)
