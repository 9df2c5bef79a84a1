"""`tci new-robot`: proposes a robot description from a URDF or MJCF, for a person to review."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer
from rich.markup import escape

from tci.cli.console import console, print_json, told_here
from tci.cli.options import AsJson
from tci.errors import CommandError, DescriptionError, Fault, meant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tci.lab.authoring.find_pads import FoundPads
    from tci.lab.authoring.proposed_arm import Sign
    from tci.lab.authoring.proposed_fingers import Trust
    from tci.robot.description import Robot

MODELS = (".urdf", ".xml", ".mjcf")
"""Suffixes of model files. In an installed package, only files with these suffixes are considered."""

COMMENT = """Proposed by tci new-robot from {file}: review it.
From that file: joints; limits of position, speed and torque, except those marked assumed.
Assumed: limits of acceleration and jerk, skin that is marked so (cones around its shapes), the response
of sensors, the initial posture, the zero of pronation (that of the robot)."""


def new_robot(
    model: Annotated[
        Path, typer.Argument(help="URDF or MJCF file of the robot. With --package, the file name is enough.")
    ],
    name: Annotated[
        str | None, typer.Option(help="Name of the robot. \\[default: the name of the model file]")
    ] = None,
    package: Annotated[
        str | None, typer.Option(help="Installed Python package that contains the model.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Description to write. \\[default: robot.xml in the folder of the model]"),
    ] = None,
    meshes: Annotated[
        Path | None,
        typer.Option(
            help="Folder to search for meshes that are missing at the paths in the model. The folder must "
            "be beside --out."
        ),
    ] = None,
    without_meshes: Annotated[
        bool,
        typer.Option(
            "--without-meshes",
            help="Leave out all meshes. The size of the skin is then estimated from the lengths of the "
            "links.",
        ),
    ] = False,
    radians: Annotated[
        bool,
        typer.Option(
            "--radians",
            help="Read the angles of an MJCF that tells no unit in radians, not degrees, as a scene in "
            "radians does that includes it.",
        ),
    ] = False,
    arms: Annotated[
        str | None,
        typer.Option(
            help="First joints of both shoulders, LEFT,RIGHT, or that of one arm alone. Needed if arms and "
            "legs can't be distinguished."
        ),
    ] = None,
    elbow: Annotated[
        int | None,
        typer.Option(
            min=-1,
            max=1,
            help="Direction, 1 or -1, in which the joint of the left elbow bends the arm. Needed if the "
            "direction can't be found.",
        ),
    ] = None,
    fingers: Annotated[
        str | None,
        typer.Option(
            metavar="names|places|none",
            help="Decision if the names and the positions of fingers contradict each other, or no fingers.",
        ),
    ] = None,
    hand_skin: Annotated[
        bool,
        typer.Option(
            "--hand-skin", help="Add assumed skin on the palm and the finger tips of hands with fingers."
        ),
    ] = False,
    cover: Annotated[
        bool | None,
        typer.Option(
            "--sleeves/--no-sleeves",
            help="Sleeves of assumed skin around the arms. \\[default: only if the model has no pads]",
        ),
    ] = None,
    linear: Annotated[
        bool,
        typer.Option(
            "--linear",
            help="Use eq. 1 and a rotated mount for shoulders that differ from the generic one by a small "
            "rotation.",
        ),
    ] = False,
    mount: Annotated[
        str | None,
        typer.Option(
            metavar="table|wall|ceiling",
            help="What one arm alone is mounted on. \\[default: table or ceiling, if its first axis is "
            "upright]",
        ),
    ] = None,
    forward: Annotated[
        str | None,
        typer.Option(
            metavar="x|y|-x|-y|z|-z",
            help="Axis of the model that points forward for one arm alone; on a wall, up. \\[default: the "
            "axis along which the arm stretches]",
        ),
    ] = None,
    side: Annotated[
        str, typer.Option(metavar="left|right", help="Side as which one arm alone, or one hand, counts.")
    ] = "left",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing description.")] = False,
    as_json: AsJson = False,
) -> None:
    """Propose the description of a robot from its URDF or MJCF.

    Finds arms, hands, fingers, head, torso and legs by their geometry, reads limits from the file, and takes
    the tactile pads that the model has (tci skin find); if it has none, it puts sleeves of assumed skin
    around the arms. A robot that tci check would refuse is not written. Check the result before you use it:
    if the model lacks a value, TCI assumes a value and marks this value as assumed.

    Example:  tci new-robot my_robot.urdf
    """
    from tci.cli.check import remarks
    from tci.cli.skin_find import pads_as_json
    from tci.lab.authoring.assumed_limits import assumed_limits
    from tci.lab.authoring.check_skin import spans
    from tci.lab.authoring.find_arm import FORWARD
    from tci.lab.authoring.find_pads import find_pads
    from tci.lab.authoring.left_out import left_out
    from tci.lab.authoring.pad_patches import table_of
    from tci.lab.authoring.proposal import propose
    from tci.lab.authoring.sleeves import assumed_skins
    from tci.lab.commissioning.plausibility import doubts
    from tci.robot.description import Mount
    from tci.robot.generic_arm import Side
    from tci.robot.mesh_files import NO_MESHES
    from tci.robot.model_format import unit_of_angles
    from tci.robot.xml import read_robot
    from tci.robot.xml.writer import write_robot

    if meshes is not None and without_meshes:
        raise CommandError("both --meshes and --without-meshes; valid: one of them")
    name = name or _plain(model.stem)
    target = out or model.parent / "robot.xml"
    if package:
        model, file = _in_package(model, package)
    else:
        file = _beside(model, target, what="model")
    if radians and (unit := unit_of_angles(model)):
        raise CommandError(
            f"--radians: {model.name} counts angles in {unit}s; valid: with an MJCF that tells no unit"
        )
    folder = None if meshes is None else _beside(meshes, target, what="folder of meshes")
    source = NO_MESHES if without_meshes else None if meshes is None else str(meshes.resolve())
    pads = find_pads(model, meshes=source, radians=radians)
    proposed = propose(
        model,
        name=name,
        package=package,
        linear=linear,
        mount=cast("Mount | None", _one_of("--mount", mount, get_args(Mount))),
        forward=_one_of("--forward", forward, FORWARD),
        side=cast("Side", _one_of("--side", side, get_args(Side))),
        meshes=source,
        radians=radians,
        arms=_both(arms),
        elbow=_direction(elbow),
        trust_fingers=_trust(fingers),
        skin_on_hands=hand_skin,
        pads=pads.pads,
        cover=cover,
    )
    if target.exists() and not force:
        raise CommandError(f"{target} exists; valid: --out with another file, or --force to replace it")
    _refuse_if_useless(proposed, pads)
    text = write_robot(
        proposed,
        file=file,
        meshes=NO_MESHES if without_meshes else folder,
        comment="\n".join(
            [COMMENT.format(file=model.name), *(pads.lines() if pads.pads or pads.left_out else ())]
        ),
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    for pad in pads.pads:
        if pad.is_table:
            target.with_name(f"{pad.name}.csv").write_text(table_of(pad), encoding="utf-8")
    target.write_text(text, encoding="utf-8")
    robot = read_robot(target)
    found, assumed = _found(robot), assumed_limits(robot)
    notes = [*left_out(robot), *assumed_skins(robot), *spans(robot), *remarks(robot)]
    doubtful = doubts(robot)
    if as_json:
        about = {"robot": name, "file": str(target), "found": found, "assumed": assumed, "remarks": notes}
        print_json({**about, "doubts": doubtful, "skin": pads_as_json(pads)})
        return
    console.print(f"wrote {target}", style="green", highlight=False, markup=False)
    for line in found:
        console.print(f"  {line}", highlight=False, markup=False)
    for line in pads.lines() if pads.pads or pads.left_out else ():
        console.print(f"  {line}", highlight=False, markup=False)
    for line in assumed:
        console.print(f"  assumed: {line}", style="yellow", highlight=False, markup=False)
    for note in notes:
        console.print(f"  note: {note}", style="yellow", highlight=False, markup=False)
    for doubt in doubtful:
        console.print(f"  doubtful: {doubt}", style="red", highlight=False, markup=False)
    console.print(
        f"next: review the file, then [bold]tci check --simulate {escape(str(target))}[/]", highlight=False
    )
    if not pads.pads and cover is None:
        console.print("no skin in this model: sleeves are assumed (--no-sleeves)", highlight=False)


def _refuse_if_useless(proposed: Robot, pads: FoundPads) -> None:
    """Raises DescriptionError if tci check would refuse the proposed robot. Its tables of taxels are in a
    temporary folder meanwhile."""
    from tci.lab.authoring.pad_patches import table_of
    from tci.lab.experiments.verdict import judge
    from tci.robot.description import Table

    patches = []
    with TemporaryDirectory() as folder:
        for pad in pads.pads:
            if pad.is_table:
                Path(folder, f"{pad.name}.csv").write_text(table_of(pad), encoding="utf-8")
        for patch in proposed.patches:
            surface = patch.surface
            if isinstance(surface, Table):
                surface = surface.model_copy(update={"file": str(Path(folder, surface.file))})
            patches.append(patch.model_copy(update={"surface": surface}))
        with told_here():
            faults = judge(proposed.model_copy(update={"patches": tuple(patches)})).faults
    if faults:
        raise DescriptionError(proposed.source, [Fault(0, fault) for fault in faults])


def _plain(stem: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in stem.lower())


def _both(arms: str | None) -> tuple[str, ...] | None:
    """The joint names in the option --arms, two or one; None without this option."""
    if arms is None:
        return None
    names = tuple(name.strip() for name in arms.split(","))
    if len(names) > 2 or not all(names):
        raise CommandError(
            f"--arms {arms}; valid: LEFT,RIGHT, the first joint of each shoulder, or that of one arm alone"
        )
    return names


def _one_of(option: str, value: str | None, valid: Sequence[str]) -> str | None:
    if value is not None and value not in valid:
        raise CommandError(f"{option} {value}; valid: {', '.join(valid)}")
    return value


def _direction(elbow: int | None) -> Sign | None:
    """Returns the bending direction of the left elbow, 1 or -1, from the option --elbow; None without this
    option. Raises CommandError if the direction is 0."""
    if elbow == 0:
        raise CommandError("--elbow 0; valid: 1 or -1")
    return None if elbow is None else 1 if elbow > 0 else -1


def _trust(fingers: str | None) -> Trust | None:
    """Returns the value of the option --fingers; None without this option. Raises CommandError if the value
    is not valid."""
    from tci.lab.authoring.proposed_fingers import Trust

    if fingers not in (None, *get_args(Trust)):
        raise CommandError(f"--fingers {fingers}; valid: {', '.join(get_args(Trust))}")
    return cast("Trust | None", fingers)


def _beside(path: Path, target: Path, *, what: str) -> str:
    """Returns `path` relative to the folder of the description `target`. Raises CommandError if the path is
    outside this folder.
    """
    folder = target.absolute().parent.resolve()
    resolved = path.resolve()
    if not resolved.is_relative_to(folder):
        raise CommandError(
            f"{path} is outside {folder}, and a description finds its {what} only in its own folder or "
            "below; valid: --out in a folder above, or --package with the installed Python package that has "
            "the model"
        )
    return resolved.relative_to(folder).as_posix()


def _in_package(model: Path, package: str) -> tuple[Path, str]:
    """Returns the path of a model in an installed package, and the last three parts of this path. `model` is
    the path of the model, or the last parts of it. Raises CommandError if the package is not installed, or if
    no file or several files of the package fit `model`.
    """
    from tci.robot.xml.node import listed

    try:
        files = distribution(package).files or ()
    except PackageNotFoundError:
        raise CommandError(
            f"no installed package {package!r}; install it with: pip install {package}"
        ) from None
    models = [entry for entry in files if entry.suffix in MODELS and entry.name != "package.xml"]
    path = model.resolve()
    found = [
        entry
        for entry in models
        if entry.parts[-len(model.parts) :] == model.parts or Path(str(entry.locate())).resolve() == path
    ]
    if len(found) != 1:
        names = listed(("/".join(entry.parts[-3:]) for entry in found or models), most=200)
        how_many = f"{len(found)} models" if found else "no model"
        near = "" if found else meant(model.name, (entry.name for entry in models))
        raise CommandError(f"the package {package!r} has {how_many} {str(model)!r}{near}; valid: {names}")
    return Path(str(found[0].locate())).resolve(), "/".join(found[0].parts[-3:])


def _found(robot: Robot) -> list[str]:
    """Returns one line of text for each proposed part, joint map and patch, so that a person can compare the
    proposal with the robot."""
    import numpy as np

    assert robot.model is not None
    lines = [f"torso: {robot.model.torso_link}"]
    for part in robot.parts:
        joints = []
        for generic in part.servos:
            if generic.servo is not None:
                how = generic.transform if generic.transform != "linear" else f"{generic.scale:+g}"
                moved = " and ".join(robot.servos[servo].name for servo in generic.moved)
                joints.append(f"{generic.name} = {moved} ({how})")
        turn = ", ".join(f"{np.rad2deg(angle):z.1f}" for angle in part.mount)
        on = f" on a mount turned by {turn} degrees (roll, pitch, yaw)" if any(part.mount) else ""
        lines.append(f"{part.name}: {', '.join(joints) or 'nothing'}{on}")
    used = {servo for part in robot.parts for generic in part.servos for servo in generic.moved}
    for name in dict.fromkeys(servo.robot_part for servo in robot.servos):
        idle = [servo.name for servo in robot.servos_of(name) if servo.index not in used]
        if idle:
            lines.append(f"{name}, without a generic joint: {', '.join(idle)}")
    lines += [f"skin {patch.name}: {patch.channels} taxels on {patch.link}{', assumed' * patch.assumed}"
              for patch in robot.patches]  # fmt: skip
    return lines
