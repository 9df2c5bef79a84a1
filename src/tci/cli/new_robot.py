"""`tci new-robot`: from a URDF to a robot description that a person looks over."""

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


COMMENT = """Proposed by tci new-robot from {file}: look it over.
From that file: joints, limits of position, speed and torque where nothing says assumed.
Assumed: limits of acceleration and jerk, the sleeves of skin (cones around the file's own shapes), the
sensors' response, the initial posture, the zero of pronation, which is the robot's own."""


def new_robot(
    urdf: Annotated[Path, typer.Argument(help="The robot's URDF.")],
    name: Annotated[str | None, typer.Option(help="Name of the robot \\[default: the file's].")] = None,
    package: Annotated[
        str | None, typer.Option(help="Installed Python package that brought the URDF, if one did.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Description to write \\[default: robot.xml beside the URDF].")
    ] = None,
    mount: Annotated[
        bool,
        typer.Option(
            "--mount", help="Eq. 1 on a mount for shoulders that are the generic one but for a small turn."
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a description that exists.")] = False,
    as_json: AsJson = False,
) -> None:
    """Propose the description of a humanoid from its URDF.

    Finds arms, hands, head, torso and legs by their geometry, takes limits from the file and puts sleeves of
    skin around the arms. Look the result over; what no file says is marked as assumed in it.

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
        f"next: look it over, then [bold]tci check --simulate {escape(str(target))}[/]", highlight=False
    )


def _plain(stem: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in stem.lower())


def _beside(urdf: Path, target: Path) -> str:
    """The model's place as seen from the description's folder."""
    folder = target.absolute().parent.resolve()
    path = urdf.resolve()
    if not path.is_relative_to(folder):
        raise CommandError(
            f"{urdf} is not in {folder} or below, where a description finds its model; valid: --out there, "
            "or --package with the installed Python package that brought the model"
        )
    return path.relative_to(folder).as_posix()


def _in_package(urdf: Path, package: str) -> str:
    """The end of the model's path in a package."""
    try:
        files = distribution(package).files or ()
    except PackageNotFoundError:
        raise CommandError(
            f"no installed package {package!r}; install it with: pip install {package}"
        ) from None
    for entry in files:
        if entry.name == urdf.name and Path(str(entry.locate())).resolve() == urdf.resolve():
            return "/".join(entry.parts[-3:])
    raise CommandError(f"the package {package!r} did not bring {urdf}")


def _found(robot: Robot) -> list[str]:
    """What a person should compare with the robot, line by line."""
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
