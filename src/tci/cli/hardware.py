"""`tci check ROBOT --hardware`: first tests of a real robot. The command asks the operator for permission
before each motion."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from tci.cli.console import console, print_json
from tci.errors import CommandError, TciError

if TYPE_CHECKING:
    from tci.drivers.diagnosis import Finding
    from tci.drivers.simulated import SimulatedDriver
    from tci.lab.commissioning.expected_motion import ExpectedMotion


class Terminal:
    """Operator who answers the questions at a keyboard."""

    def __init__(self, shown: Console) -> None:
        """Stores the console `shown`, on which the questions are printed."""
        self._shown = shown

    def may(self, what: str) -> bool:
        return self._ask(f"{what}. Now? (y/n) ") == "y"

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        return {"y": True, "n": False}.get(self._ask(f"{what} (y/n/?) "))

    def still(self, what: str) -> bool:
        return self._ask(f"{what}. Did anything move that you could see? (y/n) ") == "n"

    def press(self, patch: str, taxel: int, where: str) -> bool:
        return self._ask(f"Press and hold taxel {taxel} of {patch}: {where}. Ready? (y/n) ") == "y"

    def release(self) -> None:
        self._shown.print("  let go")

    def _ask(self, question: str) -> str:
        try:
            return self._shown.input(f"[bold]?[/] {escape(question)}").strip().lower()[:1]
        except EOFError:
            raise CommandError(
                "a question had no answer, for the input has ended; valid: a terminal, beside the robot"
            ) from None


class Simulation:
    """Replaces the operator for a simulated robot. The simulated finger presses the skin, and each question
    gets the expected answer. A person need not look at the joints, because the simulated encoders report the
    true angles.
    """

    def __init__(self, driver: SimulatedDriver, shown: Console = console) -> None:
        """Stores the driver, and the console `shown`, on which taxels that can't be pressed are named."""
        self._driver, self._shown = driver, shown

    def may(self, what: str) -> bool:
        return True

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        return True

    def still(self, what: str) -> bool:
        return True

    def press(self, patch: str, taxel: int, where: str) -> bool:
        try:
            self._driver.world.finger.poke(patch, taxel, depth=0.004)
        except TciError as error:
            self._shown.print(f"{patch} taxel {taxel} is not pressed: {error}", style="dim", highlight=False)
            return False
        return True

    def release(self) -> None:
        self._driver.world.finger.retire()


def check_hardware(
    name: str, *, via: str, parts: list[str], taxels: int, friction: Path | None, as_json: bool
) -> None:
    """Reads the robot's data, moves the joints with the operator's permission, and asks the operator to press
    the skin. Exits with status 1 if a test found a fault.

    Args:
        name: Name of the robot, or path of a description file.
        via: Driver that connects to the robot, NAME or NAME:ADDRESS.
        parts: Names of the parts, joints or patches to test; an empty list for all.
        taxels: Number of taxels to press on each patch; -1 for all, 0 for none.
        friction: File for the friction of the joints whose torques are used to detect touches; None to skip
            this measurement.
        as_json: True to print JSON instead of text.

    Raises DriverError if the robot can't be reached or armed, and UnknownNameError for a part that the robot
    lacks. Raises CommandError if the operator does not answer a question, or if `friction` is given for a
    robot that does not detect touches by joint torques.
    """
    import numpy as np

    from tci.drivers.diagnosis import Finding, Level
    from tci.drivers.registry import connect
    from tci.drivers.simulated import SimulatedDriver
    from tci.lab.commissioning.first_minutes import first_minutes, wanted
    from tci.lab.commissioning.friction import measure_friction
    from tci.robot.catalogue import load_robot
    from tci.robot.joint_calibration import file_of

    robot = load_robot(name)
    wanted(robot, parts)  # unknown names are found before the robot is commanded
    if friction is not None and not any(patch.through_joints for patch in robot.patches):
        raise CommandError(
            f"--friction: no patch of {robot.name} is felt through joints; valid: a description with "
            "<felt_through_joints/>, such as g1-bare"
        )
    with connect(robot, via, arm=True) as driver:
        # some drivers read no skin, so `driver.robot` may have fewer patches
        servos, patches = wanted(driver.robot, parts)
        shown = Console(stderr=True) if as_json else console
        operator = Simulation(driver, shown) if isinstance(driver, SimulatedDriver) else Terminal(shown)
        if not as_json:
            console.print(
                "Stand beside the robot with its emergency stop in reach. No joint moves by more than "
                f"{2 if friction is None else 10} degrees. Ctrl-C ends the test.",
                style="bold",
            )
        found, largest = first_minutes(
            driver,
            operator,
            servos=servos,
            patches=patches if taxels else (),
            taxels=None if taxels < 0 else taxels,
            show=(lambda finding: None) if as_json else _print_finding,
        )
        if friction is not None and not any(finding.level is Level.FAULT for finding in found):
            swept = [*measure_friction(driver, operator, servos, friction)]
            if friction.is_file() and friction.resolve() != file_of(robot).resolve():
                words = f"TCI reads the friction of {robot.name} from {file_of(robot)}"
                swept.append(Finding(Level.NOTE, str(friction), words, f"copy {friction} to this place"))
            found = (*found, *swept)
            if not as_json:
                for finding in swept:
                    _print_finding(finding)
    counts = Counter(finding.level for finding in found)
    if as_json:
        print_json(
            {
                "robot": robot.name,
                "via": via,
                "sound": not counts[Level.FAULT],
                "largest_motion_deg": float(np.rad2deg(largest)),
                "findings": [finding.to_json() for finding in found],
            }
        )
    else:
        console.print(
            f"{counts[Level.OK]} passed, {counts[Level.FAULT]} failed, "
            f"{counts[Level.NOTE] + counts[Level.WARNING]} to look at; "
            f"largest motion {np.rad2deg(largest):.2f} degrees",
            highlight=False,
        )
    if counts[Level.FAULT]:
        raise SystemExit(1)


def _print_finding(finding: Finding) -> None:
    from tci.cli.doctor import MARKS
    from tci.drivers.diagnosis import Level

    console.print(
        f"{MARKS[finding.level]} {escape(finding.subject)}: {escape(finding.what)}", highlight=False
    )
    if finding.advice and finding.level is not Level.OK:
        console.print(f"   {escape(finding.advice)}", style="dim", highlight=False)
