"""`tci describe`: prints the parts, joints, limits and skin of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.markup import escape

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName
from tci.errors import UnknownNameError

if TYPE_CHECKING:
    from rich.table import Table

    from tci.exports.facts import DHTable, PatchFacts
    from tci.exports.tree import Matrix
    from tci.robot.description import CartesianActuator, GenericPart, Robot


FORMATS = ("table", "json", "dh", "urdf", "kdl")
"""Output formats of `tci describe`."""


def describe(
    robot: RobotName,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            "-f",
            help="table; json: all facts, SI units; dh: Denavit-Hartenberg tables; "
            "urdf: a model for Pinocchio and others; kdl: chains for OROCOS KDL.",
        ),
    ] = "table",
    as_json: AsJson = False,
) -> None:
    """Show a robot's generic parts with joint maps and limits, and the robot's skin.

    Example:  tci describe nao --format dh
    """
    from tci.exports.facts import dh_tables, query
    from tci.exports.urdf import to_urdf
    from tci.robot.catalogue import load_robot

    if form not in FORMATS:
        raise UnknownNameError("format", form, FORMATS)
    found = load_robot(robot)
    if as_json or form == "json":
        print_json(query(found).model_dump(mode="json"))
    elif form == "urdf":
        print(to_urdf(found), end="")
    elif form == "kdl":
        chains = query(found).chains
        print_json({part: [s.model_dump(mode="json") for s in chain] for part, chain in chains.items()})
    elif form == "dh":
        for table in dh_tables(found):
            console.print(_dh_table(found, table))
    else:
        _print_tables(found)


def _print_tables(robot: Robot) -> None:
    import numpy as np

    from tci.cli.bare import tell_bare
    from tci.exports.facts import query
    from tci.runtime.arguments import capabilities_for

    patches = query(robot).patches
    console.print(f"[bold]{robot.name}[/]  {escape(robot.title)}")
    words = f"description {robot.source}\nsha256 {robot.digest}"
    console.print(words, style="dim", highlight=False, markup=False)
    for part in robot.parts:
        console.print(_part_table(robot, part))
        for point in part.cartesian:
            console.print(_cartesian(point), highlight=False, markup=False)
    for coupling in robot.couplings:
        terms = " ".join(
            f"{c:+g} {robot.servos[s].name}"
            for c, s in zip(coupling.coefficients, coupling.servos, strict=True)
        )
        lower, upper = np.rad2deg([coupling.lower, coupling.upper])
        console.print(f"coupling {coupling.name}: {lower:.1f} <= {terms} <= {upper:.1f} degrees")
    own = _own_table(robot)
    if own.row_count:
        console.print(own)
    if patches:
        console.print(_skin_table(patches))
    tell_bare(robot)
    console.print(f"capabilities: {', '.join(capabilities_for(robot)) or 'none'}", highlight=False)
    for binding in robot.all_bindings:
        console.print(
            f"driver [bold]{binding.middleware}[/]: {binding.rate:g} commands/s; the robot holds when joint "
            f"data is older than {binding.stale_after * 1000:g} ms"
        )
        if binding.sources:
            console.print(f"  with {' + '.join(binding.sources)}", highlight=False, markup=False)


def _cartesian(point: CartesianActuator) -> str:
    """Returns one line of text that describes a Cartesian actuator."""
    place = f"{point.link} {point.xyz} m" if point.link else f"{point.segment}, u = {point.u:g}"
    speed = f", at most {point.speed:g} m/s" if point.speed is not None else ""
    return f"Cartesian actuator {point.name}: {place}; targets from the {point.frame}{speed}"


def _table(title: str, caption: str, *columns: str) -> Table:
    from rich.table import Table

    table = Table(
        title=title, title_justify="left", caption=caption, caption_justify="left",
        box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True,
    )  # fmt: skip
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index < 2 else "right", no_wrap=True)
    return table


def _own_table(robot: Robot) -> Table:
    """Returns a table of the servos that move no generic joint."""
    table = _table(
        "joints without a generic joint",
        "degrees; command these joints by driver.native(PART)",
        "part", "joint", "lower", "upper", "speed",
    )  # fmt: skip
    used = {servo for part in robot.parts for generic in part.servos for servo in generic.moved}
    for servo in robot.servos:
        if servo.index not in used:
            limits = servo.limits
            table.add_row(
                servo.robot_part, servo.name,
                _degrees(limits.lower), _degrees(limits.upper), _degrees(limits.velocity),
            )  # fmt: skip
    return table


def _part_table(robot: Robot, part: GenericPart) -> Table:
    import numpy as np

    side = f", {part.side}" if part.side else ""
    mount = ", ".join(f"{angle:g}" for angle in np.rad2deg(part.mount))
    others = dict.fromkeys(joint.transform for joint in part.servos if joint.transform != "linear")
    other = f", or without a gamma {' or '.join(others)}" if others else ""
    table = _table(
        f"{part.name} ({part.kind}{side}), mount {mount}",
        f"degrees; generic = gamma * robot + sigma{other}; lower, upper and speed: of the robot's joint",
        "generic joint", "robot's joint", "gamma", "sigma", "lower", "upper", "speed", "initial",
    )  # fmt: skip
    for generic in part.servos:
        if generic.servo is None:
            table.add_row(f"{generic.id} {generic.name}", f"[dim]none: {np.rad2deg(generic.fixed):g}[/]")
            continue
        servo = robot.servos[generic.servo]
        limits = servo.limits
        plain = generic.transform == "linear"
        table.add_row(
            f"{generic.id} {generic.name}", servo.name,
            f"{generic.scale:g}" if plain else "", _degrees(generic.offset) if plain else "",
            _degrees(limits.lower), _degrees(limits.upper), _degrees(limits.velocity),
            _degrees(generic.initial),
        )  # fmt: skip
    return table


def _dh_table(robot: Robot, facts: DHTable) -> Table:
    import numpy as np

    table = _table(
        f"{facts.part}: torso to {facts.link}, {facts.convention} convention",
        f"base {_pose(facts.base)}; tool {_pose(facts.tool)}. mm and degrees; a joint turns by theta + q",
        "", "joint", "a", "alpha", "d", "theta",
    )  # fmt: skip
    for index, row in enumerate(facts.rows):
        table.add_row(
            str(index), robot.servos[row.servo].name, f"{1e3 * row.a:.2f}", f"{np.rad2deg(row.alpha):.3f}",
            f"{1e3 * row.d:.2f}", f"{np.rad2deg(row.theta):.3f}",
        )  # fmt: skip
    return table


def _pose(matrix: Matrix) -> str:
    """Returns a pose (4, 4) as text: origin [mm] and rotation vector [degrees]."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    pose = np.array(matrix)
    origin = " ".join(f"{1e3 * value:.1f}" for value in pose[:3, 3])
    turn = np.rad2deg(Rotation.from_matrix(pose[:3, :3]).as_rotvec())
    return f"at {origin}, turned {' '.join(f'{value:.1f}' for value in turn)}"


def _degrees(angle: float | None) -> str:
    import numpy as np

    return "unknown" if angle is None else f"{np.rad2deg(angle):.1f}"


def _skin_table(patches: tuple[PatchFacts, ...]) -> Table:
    table = _table(
        "skin",
        "length, r1, r2: the paper's truncated cone (eq. 4) fitted to the taxels; rms, max: its error",
        "patch", "from", "taxels", "Hz", "cm2", "length", "r1", "r2", "rms", "max mm",
    )  # fmt: skip
    for patch in patches:
        cone, fit = patch.cone, []
        if cone is not None:
            errors = (cone.r1, cone.r2, cone.rms, cone.largest)
            fit = [f"{1e3 * cone.length:.0f}", *(f"{1e3 * value:.1f}" for value in errors)]
        taxels = "by joints" if patch.through_joints else str(len(patch.taxels))
        table.add_row(
            patch.name, patch.kind.split("_")[-1] + ", assumed" * patch.assumed, taxels, f"{patch.rate:g}",
            f"{1e4 * patch.area:.0f}", *fit,
        )  # fmt: skip
    return table
