"""NAOqi services of a served robot, with the methods of a real NAO for joints, touch and memory. Each method
has the name, the arguments and the meaning that Aldebaran's documentation gives. Threads of `qi` call the
methods."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import qi

from tci.robot.description import Servo
from tci.wires.naoqi.board import Board
from tci.wires.naoqi.postures import ALRobotPosture

SETTLED = 0.01
"""Largest distance [rad] from the target at which a joint counts as arrived in a blocking motion. Assumed:
0.6 degrees; because of backlash, a joint may never come closer to its target."""
LONGEST = 1000
"""Largest number of joint names, or of keys of ALMemory, in one call."""


@qi.multiThreaded()
class ALMotion:
    """NAOqi's service for joints: angles, stiffness, limits, and blocking motions."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._servos = {servo.name: servo for servo in board.robot.servos}
        self._breath: dict[str, bool] = {}
        self._kills = [0] * len(board.robot.servos)
        """How often the motions of each servo were killed."""

    def getBodyNames(self, name: str) -> list[str]:
        """Returns the names of the joints of a chain, or of all joints if `name` is `Body`."""
        return [servo.name for servo in self._find(name)]

    @qi.bind(qi.List(qi.Float), [qi.Dynamic, qi.Bool])
    def getAngles(self, names: Any, useSensors: bool) -> list[float]:
        """Returns measured angles [rad] if `useSensors` is True, otherwise commanded angles [rad]."""
        angles = self._board.measured if useSensors else self._board.commanded
        return [angles[servo.index] for servo in self._find(names)]

    @qi.bind(qi.List(qi.Float), [qi.Dynamic])
    def getStiffnesses(self, names: Any) -> list[float]:
        """Returns stiffnesses 0..1."""
        shares = self._board.stiffness
        return [shares[servo.index] for servo in self._find(names)]

    def getLimits(self, name: Any) -> list[list[float]]:
        """Returns for each joint: lower limit [rad], upper limit [rad], top speed [rad/s], largest torque [N
        m]."""
        return [_limits(servo) for servo in self._find(name)]

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic])
    def setStiffnesses(self, names: Any, stiffnesses: Any) -> None:
        """Sets stiffnesses 0..1. `stiffnesses` is one number for all joints, or one number per joint."""
        servos = self._find(names)
        shares = _numbers(stiffnesses, len(servos), "stiffness", 0.0, 1.0)
        self._board.stiffen(servos, shares)

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic, qi.Float])
    def setAngles(self, names: Any, angles: Any, fractionMaxSpeed: float) -> None:
        """Moves joints to `angles` [rad] at the fraction `fractionMaxSpeed` of their top speed. A later call
        immediately replaces these targets."""
        servos = self._find(names)
        wanted = _numbers(angles, len(servos), "angle [rad]", -7.0, 7.0)
        share = _numbers(fractionMaxSpeed, 1, "fractionMaxSpeed", 1e-6, 1.0)[0]
        self._board.move(servos, wanted, [share * _limits(servo)[2] for servo in servos])

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic, qi.Float])
    def changeAngles(self, names: Any, changes: Any, fractionMaxSpeed: float) -> None:
        """Moves joints by `changes` [rad] from their commanded angles."""
        servos = self._find(names)
        changed = _numbers(changes, len(servos), "change [rad]", -7.0, 7.0)
        commanded = self._board.commanded
        wanted = [commanded[servo.index] + change for servo, change in zip(servos, changed, strict=True)]
        self.setAngles([servo.name for servo in servos], wanted, fractionMaxSpeed)

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic, qi.Float])
    def angleInterpolationWithSpeed(self, names: Any, targetAngles: Any, maxSpeedFraction: float) -> None:
        """Moves joints to `targetAngles` [rad]. Returns when all joints have arrived."""
        servos = self._find(names)
        kills = list(self._kills)
        self.setAngles(names, targetAngles, maxSpeedFraction)
        wanted = _numbers(targetAngles, len(servos), "angle [rad]", -7.0, 7.0)
        slowest = min(maxSpeedFraction * _limits(servo)[2] for servo in servos)
        self._wait(servos, wanted, 2.0 + 7.0 / slowest, kills)

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic, qi.Dynamic, qi.Bool])
    def angleInterpolation(self, names: Any, angleLists: Any, timeLists: Any, isAbsolute: bool) -> None:
        """Moves each joint through its angles [rad], to be at each one at its time [s]. Returns when all
        joints have arrived.

        `angleLists` and `timeLists` have a number or a list of numbers for each joint; a single joint may
        have its list alone. Relative angles count from where the joint is commanded at the call. Between two
        angles a joint moves at constant speed as far as the gate lets it.
        """
        servos = self._find(names)
        angles = _lists(angleLists, len(servos), "angles [rad]", -7.0, 7.0)
        times = _lists(timeLists, len(servos), "times [s]", 1e-3, 600.0)
        for servo, keys, moments in zip(servos, angles, times, strict=True):
            rising = all(a < b for a, b in itertools.pairwise(moments))
            if len(keys) != len(moments) or not rising:
                raise ValueError(
                    f"{servo.name}: {len(keys)} angles at the times {str(moments)[:80]}; valid: a time for "
                    "each angle, in rising order"
                )
        commanded, kills = self._board.commanded, list(self._kills)
        steps: list[tuple[float, Servo, float, float]] = []
        ends = []
        for servo, keys, moments in zip(servos, angles, times, strict=True):
            here, now = commanded[servo.index], 0.0
            origin = 0.0 if isAbsolute else here
            for key, moment in zip(keys, moments, strict=True):
                speed = max(abs(origin + key - here) / (moment - now), 1e-3)
                steps.append((now, servo, origin + key, speed))
                here, now = origin + key, moment
            ends.append(here)
        begin = time.monotonic()
        steps.sort(key=itemgetter(0))
        for now, together in itertools.groupby(steps, key=itemgetter(0)):
            while (left := begin + now - time.monotonic()) > 0.0:
                time.sleep(min(left, 0.01))
            if self._killed(servos, kills):
                return
            _, moved, targets, speeds = zip(*together, strict=True)
            self._board.move(moved, targets, speeds)
        self._wait(servos, ends, 2.0 + max(moments[-1] for moments in times), kills)

    @qi.bind(qi.Void, [qi.Dynamic, qi.Dynamic, qi.Dynamic])
    def angleInterpolationBezier(self, jointNames: Any, times: Any, controlPoints: Any) -> None:
        """Moves each joint through the angles [rad] of its control points. The tangents of the curve are left
        out: between two angles a joint moves at constant speed."""
        lists = controlPoints if isinstance(controlPoints, list | tuple) else [controlPoints]
        if not all(isinstance(points, list | tuple) and points for points in lists):
            raise ValueError(f"controlPoints {str(lists)[:80]}; valid: a list of [angle, in, out] per joint")
        angles = [
            [point[0] if isinstance(point, list | tuple) and point else point for point in points]
            for points in lists
        ]
        self.angleInterpolation(jointNames, angles, times, True)

    def openHand(self, handName: str) -> None:
        """Opens `LHand` or `RHand`. Returns when the hand is open."""
        self._hand(handName, 1)

    def closeHand(self, handName: str) -> None:
        """Closes `LHand` or `RHand`. Returns when the hand is closed."""
        self._hand(handName, 0)

    def _hand(self, name: str, limit: int) -> None:
        hands = [servo for servo in ("LHand", "RHand") if servo in self._servos]
        if name not in hands:
            valid = ", ".join(hands) or "none, this robot has no hands"
            raise ValueError(f"hand {str(name)[:40]!r}; valid: {valid}")
        self.angleInterpolationWithSpeed(name, _limits(self._servos[name])[limit], 1.0)

    def killTasksUsingResources(self, resourceNames: Any) -> None:
        """Stops joints at their present angles, and ends the motions that wait for them."""
        servos, here = self._find(resourceNames), self._board.measured
        for servo in servos:
            self._kills[servo.index] += 1
        movable = [servo for servo in servos if servo.limits.velocity is not None]
        self._board.move(movable, [here[s.index] for s in movable], [_limits(s)[2] for s in movable])

    def killAll(self) -> None:
        """Stops all joints at their present angles."""
        self.killTasksUsingResources("Body")

    def wakeUp(self) -> None:
        """Sets full stiffness in all joints."""
        self.setStiffnesses("Body", 1.0)

    def rest(self) -> None:
        """Sets zero stiffness in all joints. A real NAO first sits down, but a served NAO does not sit
        down."""
        self.setStiffnesses("Body", 0.0)

    def robotIsWakeUp(self) -> bool:
        """Returns True if at least one joint has a stiffness above 0."""
        return max(self._board.stiffness) > 0.0

    def getBreathEnabled(self, chain: str) -> bool:
        """Returns True if breathing (slight motions when idle) is switched on for the chain."""
        return self._breath.get(chain, False)

    def setBreathEnabled(self, chain: str, enabled: bool) -> None:
        """Stores the setting without any other effect."""
        self._breath[str(chain)[:40]] = bool(enabled)

    def _find(self, names: Any) -> list[Servo]:
        """Returns the servos of a joint, of a chain, or of a list of both, given by name. Raises ValueError
        for an unknown name."""
        found: list[Servo] = []
        every = list(names) if isinstance(names, list | tuple) else [names]
        if len(every) > LONGEST:
            raise ValueError(f"{len(every)} names; valid: at most {LONGEST}")
        for name in every:
            if not isinstance(name, str):
                raise ValueError(f"joint or chain {str(name)[:40]}; valid: names")
            if name in ("Body", "Joints", "JointActuators", "Actuators"):
                found += self._servos.values()
            elif name in self._servos:
                found.append(self._servos[name])
            else:
                chain = [servo for servo in self._servos.values() if servo.robot_part == name]
                if not chain:
                    raise ValueError(
                        f"no joint or chain {str(name)[:40]!r}; valid: Body, {', '.join(self._servos)}"
                    )
                found += chain
        return found

    def _killed(self, servos: Sequence[Servo], kills: Sequence[int]) -> bool:
        """Returns True if a motion of one of the servos was killed since `kills` was read."""
        return any(self._kills[servo.index] != kills[servo.index] for servo in servos)

    def _wait(
        self, servos: Sequence[Servo], wanted: Sequence[float], longest: float, kills: Sequence[int]
    ) -> None:
        """Returns when the servos are where they are wanted, or when their motion was killed."""
        end = time.monotonic() + longest
        while time.monotonic() < end:
            here = self._board.measured
            if all(abs(here[s.index] - w) < SETTLED for s, w in zip(servos, wanted, strict=True)):
                return
            if self._killed(servos, kills):
                return
            time.sleep(0.01)
        raise RuntimeError(
            f"{', '.join(servo.name for servo in servos)} did not arrive within {longest:.1f} s"
        )


@qi.multiThreaded()
class ALMemory:
    """Values by key: the robot's own values, and values that clients insert."""

    def __init__(self, live: dict[str, Callable[[], Any]]) -> None:
        """Stores `live`: for each key of the robot, a function that returns the present value."""
        self._live = live
        self._own: dict[str, tuple[Any, float]] = {}
        self._lock = threading.Lock()

    def getData(self, key: str) -> Any:
        """Returns the value of a key. Raises KeyError if the key does not exist."""
        found, value = self._value(key)
        if not found:
            raise KeyError(f"getData: no data at key {str(key)[:80]}")
        return value

    @qi.bind(qi.Dynamic, [qi.Dynamic])
    def getListData(self, keys: Any) -> list[Any]:
        """Returns the values of several keys. The value of a key that does not exist is None."""
        if not isinstance(keys, list | tuple) or len(keys) > LONGEST:
            raise ValueError(f"getListData: valid: a list of at most {LONGEST} keys")
        if not all(isinstance(key, str) for key in keys):
            raise ValueError(f"getListData: {str(keys)[:80]}; valid: names of keys")
        return [self._value(key)[1] for key in keys]

    def getTimestamp(self, key: str) -> list[Any]:
        """Returns a value and its time on the robot's clock, as seconds and microseconds. The time of an
        inserted value is the time of the insertion; the time of a robot's value is the present time."""
        value = self.getData(key)
        stamp = self._own[key][1] if key in self._own else time.time()
        return [value, int(stamp), int(1e6 * (stamp % 1.0))]

    def getDataListName(self) -> list[str]:
        """Returns all keys."""
        with self._lock:
            return sorted({*self._live, *self._own})

    @qi.bind(qi.Void, [qi.String, qi.Dynamic])
    def insertData(self, key: str, value: Any) -> None:
        """Inserts a value. At a key of the robot itself, such as a tactile switch, it hides what the robot
        says until 0 is inserted."""
        with self._lock:
            if key in self._live and isinstance(value, int | float) and value == 0:
                self._own.pop(key, None)
                return
            if len(self._own) >= LONGEST and key not in self._own:
                raise ValueError(f"{LONGEST} keys; there is no room for more")
            self._own[key] = (value, time.time())

    raiseEvent = insertData

    def removeData(self, key: str) -> None:
        """Removes a value that was inserted. Raises KeyError if there is none."""
        with self._lock:
            if self._own.pop(key, None) is None:
                raise KeyError(f"removeData: no data at key {str(key)[:80]}")

    def _value(self, key: Any) -> tuple[bool, Any]:
        with self._lock:
            if key in self._own:
                return True, self._own[key][0]
        live = self._live.get(key)
        return (True, live()) if live is not None else (False, None)


@qi.multiThreaded()
class ALAutonomousLife:
    """NAOqi's service for autonomous life. The state is only stored and causes no motion."""

    def __init__(self) -> None:
        self._state = "disabled"

    def getState(self) -> str:
        """Returns the state of autonomous life."""
        return self._state

    def setState(self, state: str) -> None:
        """Sets the state of autonomous life."""
        valid = ("disabled", "solitary", "interactive", "safeguard")
        if state not in valid:
            raise ValueError(f"state {str(state)[:40]!r}; valid: {', '.join(valid)}")
        self._state = state


@qi.multiThreaded()
class ALSystem:
    """Identity of the served robot."""

    def systemVersion(self) -> str:
        """Returns a NAOqi version with the note that TCI serves this robot."""
        return "2.8 (served by TCI)"


def all_services(board: Board) -> dict[str, object]:
    """Returns all services by name. ALMotion is the last one, so a client that finds ALMotion finds all
    services."""
    motion = ALMotion(board)
    return {
        "ALMemory": ALMemory(board.keys()),
        "ALAutonomousLife": ALAutonomousLife(),
        "ALSystem": ALSystem(),
        "ALRobotPosture": ALRobotPosture(board, motion.angleInterpolationWithSpeed, motion.killAll),
        "ALMotion": motion,
    }


def _limits(servo: Servo) -> list[float]:
    """Returns lower limit [rad], upper limit [rad], top speed [rad/s] and largest torque [N m] of a servo.
    Unknown limits are replaced by those of a hand: 0, 1, 8.33 and 0."""
    limits = servo.limits
    values = (limits.lower, limits.upper, limits.velocity, limits.torque)
    return [float(b if a is None else a) for a, b in zip(values, (0.0, 1.0, 8.33, 0.0), strict=True)]


def _numbers(values: Any, count: int, what: str, lowest: float, highest: float) -> list[float]:
    """Returns `count` numbers; a single number is repeated `count` times. Raises ValueError if `values` has
    another length or a number that is not between `lowest` and `highest`."""
    given = list(values) if isinstance(values, list | tuple) else [values] * count
    valid = len(given) == count and all(
        isinstance(v, int | float) and math.isfinite(v) and lowest <= v <= highest for v in given
    )
    if not valid:
        raise ValueError(f"{what} {str(values)[:80]}; valid: {count} numbers of {lowest:g} to {highest:g}")
    return [float(value) for value in given]


def _lists(values: Any, count: int, what: str, lowest: float, highest: float) -> list[list[float]]:
    """Returns a list of numbers for each of `count` joints, of which a single one may have its list alone; a
    number stands for a list of one, and a single number for all joints. Raises ValueError as `_numbers`."""
    given = list(values) if isinstance(values, list | tuple) else [values] * count
    if count == 1 and not any(isinstance(value, list | tuple) for value in given):
        given = [given]
    if len(given) != count:
        raise ValueError(f"{len(given)} lists of {what}; valid: {count}, one for each joint")
    lists = [list(value) if isinstance(value, list | tuple) else [value] for value in given]
    if not all(1 <= len(one) <= LONGEST for one in lists):
        raise ValueError(f"{what} {str(values)[:80]}; valid: 1 to {LONGEST} for each joint")
    return [_numbers(one, len(one), what, lowest, highest) for one in lists]
