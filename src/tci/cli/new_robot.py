"""`tci new-robot`: proposes a robot description from a URDF, for a person to review."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from tci.cli.console import console, print_json
from tci.cli.options import AsJson
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.robot.description import Robot


COMMENT = """Proposed by tci new-robot from {file}: review it.
From that file: joints; limits of position, speed and torque, except those marked assumed.
Assumed: limits of acceleration and jerk, the sleeves of skin (cones around the file's shapes), the sensors'
response, the initial posture, the zero of pronation (that of the robot)."""


def new_robot(
    urdf: Annotated[Path, typer.Argument(help="URDF file of the robot.")],
    name: Annotated[str | None, typer.Option(help="Name of the robot. \\[default: that of the file]")] = None,
    package: Annotated[
        str | None, typer.Option(help="Installed Python package that contains the URDF, if one does.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Description to write. \\[default: robot.xml beside the URDF]")
    ] = None,
    mount: Annotated[
        bool,
        typer.Option(
            "--mount",
            help="Use eq. 1 and a rotated mount for shoulders that differ from the generic one by a small "
            "rotation.",
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a description that exists.")] = False,
    as_json: AsJson = False,
) -> None:
    """Propose the description of a humanoid from its URDF.

    Finds arms, hands, head, torso and legs by their geometry, reads limits from the file and puts sleeves of
    skin around the arms. Review the result: values that the file does not have are marked as assumed in it.

    Example:  tci new-robot my_robot.urdf
    """
    from tci.authoring.proposal import propose
    from tci.cli.check import remarks
    from tci.robot.xml import read_robot
    from tci.robot.xml.writer import write_robot

    name = name or _plain(urdf.stem)
    target = out or urdf.parent / "robot.xml"
    file = _in_package(urdf, package) if package else _beside(urdf, target)
    proposed = propose(urdf, name=name, package=package, mount=mount)
    if target.exists() and not force:
        raise CommandError(f"{target} exists; valid: --out with another file, or --force to replace it")
    text = write_robot(proposed, file=file, comment=COMMENT.format(file=urdf.name))
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")
    robot = read_robot(target)
    found = _found(robot)
    if as_json:
        print_json({"robot": name, "file": str(target), "found": found, "remarks": remarks(robot)})
        return
    console.print(f"wrote {target}", style="green", highlight=False, markup=False)
    for line in found:
        console.print(f"  {line}", highlight=False, markup=False)
    for note in remarks(robot):
        console.print(f"  note: {note}", style="yellow", highlight=False, markup=False)
    console.print(
        f"next: review the file, then [bold]tci check --simulate {escape(str(target))}[/]", highlight=False
    )


def _plain(stem: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in stem.lower())


def _beside(urdf: Path, target: Path) -> str:
    """Returns the path of the model relative to the description's folder.

    Raises CommandError for a model outside that folder.
    """
    folder = target.absolute().parent.resolve()
    path = urdf.resolve()
    if not path.is_relative_to(folder):
        raise CommandError(
            f"{urdf} is outside {folder}, and a description finds its model only in its own folder or below; "
            "valid: --out beside the URDF, or --package with the installed Python package that has the model"
        )
    return path.relative_to(folder).as_posix()


def _in_package(urdf: Path, package: str) -> str:
    """Returns the end of the model's path in an installed package.

    Raises CommandError when the package is not installed or has no such file.
    """
    try:
        files = distribution(package).files or ()
    except PackageNotFoundError:
        raise CommandError(
            f"no installed package {package!r}; install it with: pip install {package}"
        ) from None
    for entry in files:
        if entry.name == urdf.name and Path(str(entry.locate())).resolve() == urdf.resolve():
            return "/".join(entry.parts[-3:])
    raise CommandError(f"the package {package!r} does not contain {urdf}; valid: a file that it installed")


def _found(robot: Robot) -> list[str]:
    """Lists the parts, joint maps and patches that were found, one line each, to compare with the robot."""
    import numpy as np

    assert robot.model is not None
    lines = [f"torso: {robot.model.torso_link}"]
    for part in robot.parts:
        joints = []
        for generic in part.servos:
            if generic.servo is not None:
                how = generic.transform if generic.transform != "linear" else f"{generic.scale:+g}"
                joints.append(f"{generic.name} = {robot.servos[generic.servo].name} ({how})")
        turn = ", ".join(f"{np.rad2deg(angle):.1f}" for angle in part.mount)
        on = f" on a mount turned by {turn} degrees (roll, pitch, yaw)" if any(part.mount) else ""
        lines.append(f"{part.name}: {', '.join(joints) or 'nothing'}{on}")
    lines += [f"skin {patch.name}: {patch.channels} taxels on {patch.link}" for patch in robot.patches]
    return lines
