"""Draws the figure of a recording: forces, response, joint angles, latencies, and the unrolled skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from tci.body.generic_body import GenericBody
from tci.body.tactile import unrolled
from tci.capabilities.fields import ReceptiveField
from tci.errors import RecordingError, UnknownNameError
from tci.lab.pictures.paint import FIELD_COLOURS, PRESSURE_COLOURS
from tci.messages import JointReading
from tci.messages.frames import Array
from tci.recording.perceived import Perceived
from tci.recording.touches import RecordedTouch, find_touches
from tci.robot.description import Robot
from tci.robot.generic_arm import JOINTS, SEGMENTS
from tci.robot.joint_map import generic_posture
from tci.robot.limb import RHO
from tci.skin.skin import Skin

# Colours are chosen by eye.
INK, PALE, GRID = "#1d2733", "#5b6878", "#e3e7eb"
LINES = ("#1c7ed6", "#e8590c", "#2b8a3e", "#9c36b5", "#0b7285")
SIDES = ("flexor", "lateral", "extensor", "medial")


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Time series of a recording, with one value per period."""

    time: Array
    """Time (k,) [s] of each period."""
    forces: dict[str, Array]
    """Force (k,) [N] on each patch that was touched, by the patch's name."""
    response: Array
    """Largest commanded speed (k,) [rad/s] of all servos."""
    measured: dict[str, Array]
    """Measured generic angles (k, n) [rad] of each part that is drawn."""
    sent: dict[str, Array]
    """Generic angles (k, n) [rad] that were sent to the n joints of each drawn part in k periods, by the
    part's name. The value is NaN in periods in which no angles were sent to the part."""
    peak: dict[str, Array]
    """Largest pressure (taxels,) [Pa] of each patch during the recording."""
    joints: JointReading
    """Reading of the joints at the first touch."""
    touches: tuple[RecordedTouch, ...]
    """Touches of all parts."""


def collect(
    robot: Robot,
    periods: Sequence[Perceived],
    *,
    begin: float = -np.inf,
    end: float = np.inf,
    part: str | None,
) -> tuple[tuple[str, ...], Series]:
    """Returns the names of the parts to draw, and their time series.

    With `part`, only this part is drawn. By default, the first touched part (or the first arm, if there is no
    touch) and all parts that respond to a touch are drawn.

    Raises RecordingError if no period lies between `begin` and `end` [s], and UnknownNameError for an unknown
    part.
    """
    chosen = [period for period in periods if begin <= period.now <= end]
    if not chosen:
        there = f"; valid: {periods[0].now:.3f} to {periods[-1].now:.3f} s" if periods else ""
        raise RecordingError(f"no period from {begin} to {end} s{there}")
    touches = find_touches(chosen)
    arms = [known.name for known in robot.parts if known.kind == "arm"] or [p.name for p in robot.parts]
    posture = chosen[0].perception.posture
    respond = {name for touch in touches for name in (*touch.commands, *touch.motions)}
    first_part = part or (touches[0].part if touches else arms[0])
    robot.part(first_part)
    if first_part not in posture:
        raise UnknownNameError("generic part", first_part, posture)
    others = [] if part else [name for name in posture if name in respond - {first_part}]
    parts = first_part, *others
    forces: dict[str, Array] = {}
    peak: dict[str, Array] = {}
    response = []
    names = [patch.name for patch in robot.patches]
    for index, period in enumerate(chosen):
        for contact in period.perception.contacts:
            forces.setdefault(contact.patch, np.zeros(len(chosen)))[index] += contact.force
        for name, pressure in period.skin.by_patch(names).items():
            peak[name] = np.maximum(peak.get(name, 0.0), pressure)
        speeds = period.decision["velocity"] if period.decision else ()
        response.append(np.abs(speeds).max(initial=0.0))
    first = next((p for p in chosen if touches and p.now >= touches[0].began), chosen[0])
    return parts, Series(
        time=np.array([period.now for period in chosen]),
        forces=forces,
        response=np.array(response),
        measured={name: np.array([p.perception.posture[name] for p in chosen]) for name in parts},
        sent={name: np.array([_sent(robot, p, name) for p in chosen]) for name in parts},
        peak=peak,
        joints=first.reading.joints,
        touches=tuple(touches),
    )


def _sent(robot: Robot, period: Perceived, part: str) -> Array:
    """Returns the generic angles (n,) [rad] that were sent to a part. The angles are NaN before the part's
    servos are commanded."""
    mapped = [servo.servo for servo in robot.part(part).servos]
    decision = period.decision
    nothing = np.full(len(mapped), np.nan)
    if decision is None or not set(mapped) & set(decision["servos"].tolist()):
        return nothing
    position = np.array(period.reading.joints.position)
    position[decision["servos"].astype(int)] = decision["position"]
    still = np.zeros_like(position)
    return generic_posture(robot, JointReading(period.now, 0, position, still))[part]


def draw(robot: Robot, series: Series, path: Path, *, fields: Sequence[ReceptiveField], title: str) -> None:
    """Writes the figure in the format of the path's suffix (png, pdf, svg). The figure shows the unrolled
    skin of the first part.

    Raises UnknownNameError for another format.
    """
    form = path.suffix.removeprefix(".").lower()
    first, *others = series.measured
    more = 2.3 * len(others)
    figure = Figure(figsize=(7.2, 8.6 + more), facecolor="white", layout="constrained")
    canvas = FigureCanvasAgg(figure)
    if form not in canvas.get_supported_filetypes():
        raise UnknownNameError("format of a figure", form, ("png", "pdf", "svg"))
    figure.suptitle(title, fontsize=9, color=INK, x=0.01, ha="left")
    upper, lower = figure.subfigures(2, 1, height_ratios=(5.1 + more, 3.5), squeeze=False)[:, 0]
    heights = 1.0, 0.8, *(1.5 for _ in series.measured)
    lines = upper.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    shown = _window(series)
    _draw_forces(lines[0], series)
    _draw_response(lines[1], series)
    for axes, part in zip(lines[2:], series.measured, strict=True):
        _draw_angles(axes, robot, series, part)
    lines[-1].set_xlim(*shown)
    lines[-1].set_xlabel("time [s]")
    left, right = lower.subplots(1, 2, width_ratios=(1.6, 1.0))
    arm = robot.part(first).kind == "arm"
    dots = _draw_arm(left, robot, series, first, fields) if arm else _draw_patch(left, robot, series, first)
    if dots is not None:
        _draw_scale(lower, left, dots)
    _draw_latency(right, series)
    for axes in (*lines, left, right):
        _plain(axes)
    figure.savefig(path, dpi=200, format=form)


def _window(series: Series) -> tuple[float, float]:
    """Returns the time range [s] that the figure shows: the touches with some time before and after, or the
    whole recording if there is no touch."""
    begin, end = float(series.time[0]), float(series.time[-1])
    if series.touches:
        begin = max(begin, series.touches[0].began - 0.3)
        end = min(end, series.touches[-1].ended + 1.5)
    return begin, max(end, begin + 1e-3)


def _draw_forces(axes: Axes, series: Series) -> None:
    axes.set_ylabel("force [N]")
    for index, (name, force) in enumerate(series.forces.items()):
        axes.plot(series.time, force, color=LINES[index % len(LINES)], label=name.replace("_", " "))
    if series.forces:
        axes.legend(loc="upper right")
    else:
        axes.text(0.5, 0.5, "no touch", transform=axes.transAxes, ha="center", color=PALE)
    axes.set_ylim(bottom=0.0)


def _draw_response(axes: Axes, series: Series) -> None:
    axes.set_ylabel("response [deg/s]\nfastest servo")
    axes.plot(series.time, np.rad2deg(series.response), color=INK)
    axes.set_ylim(bottom=0.0)


def _draw_angles(axes: Axes, robot: Robot, series: Series, part: str) -> None:
    axes.set_ylabel(f"{part.replace('_', ' ')} [deg]")
    for joint, servo in enumerate(robot.part(part).servos):
        if servo.servo is None:
            continue
        name = JOINTS[joint] if robot.part(part).kind == "arm" else servo.name
        colour = LINES[joint % len(LINES)]
        measured, sent = np.rad2deg(series.measured[part][:, joint]), np.rad2deg(series.sent[part][:, joint])
        axes.plot(series.time, measured, color=colour, label=name.replace("_", " "))
        axes.plot(series.time, sent, color=colour, linestyle=(0, (2, 2)))
    axes.plot([], [], color=PALE, linestyle=(0, (2, 2)), label="sent")
    axes.legend(loc="upper right", ncols=3)


def _draw_arm(
    axes: Axes, robot: Robot, series: Series, part: str, fields: Sequence[ReceptiveField]
) -> PathCollection | None:
    """Draws the unrolled skin of an arm: the largest pressure of every taxel, and the outlines of `fields`.
    The axes are the angle around the limb and the position along the limb."""
    skin, dots = Skin(robot), None
    for patch in robot.patches:
        if patch.part != part or patch.segment not in SEGMENTS:
            continue
        u, theta, _ = skin.limb(patch.name, series.joints)
        along = u + SEGMENTS.index(patch.segment)
        dots = _draw_taxels(axes, np.column_stack([np.rad2deg(theta), along]), series, patch.name)
    for index, field in enumerate(fields):
        edge = _outline(field)
        colour = FIELD_COLOURS[index % len(FIELD_COLOURS)]
        for shift in (-360.0, 0.0, 360.0):
            axes.fill(
                np.rad2deg(edge[:, 0]) + shift, edge[:, 1] + SEGMENTS.index(field.segment),
                facecolor=(*colour, 0.22), edgecolor=colour, linewidth=0.8,
            )  # fmt: skip
    axes.set(xlim=(-180.0, 180.0), ylim=(2.05, -0.05), facecolor="#f7f8f9")
    axes.set_xticks([-90, 0, 90, 180], ["medial", "flexor", "lateral", "extensor"])
    axes.set_yticks([0.5, 1.5], ["upper arm", "forearm"], rotation=90, va="center")
    axes.axhline(1.0, color=PALE, linewidth=0.6)
    axes.set_title(f"skin of the {part.replace('_', ' ')}, unrolled; fields of the reflex", loc="left")
    return dots


def _draw_patch(axes: Axes, robot: Robot, series: Series, part: str) -> PathCollection | None:
    """Draws the largest pressure of every taxel of one patch, in the plane of the patch's pressure image.

    If the part has several patches, the patch with the largest pressure is drawn.
    """
    own = [patch.name for patch in robot.skin if patch.part == part]
    axes.set_facecolor("#f7f8f9")
    if not own:
        axes.set_title(f"{part.replace('_', ' ')} has no skin", loc="left")
        return None
    name = max(own, key=lambda one: float(np.max(series.peak.get(one, 0.0))))
    places = 1e3 * unrolled(GenericBody(robot), name, series.joints)[0]
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="mm", ylabel="mm")
    axes.set_title(f"{name.replace('_', ' ')}, seen from outside", loc="left")
    return _draw_taxels(axes, places, series, name)


def _draw_taxels(axes: Axes, places: Array, series: Series, patch: str) -> PathCollection:
    """Draws taxels as dots at `places` (n, 2). Colour and size of a dot show the taxel's largest pressure."""
    colours = LinearSegmentedColormap.from_list("pressure", PRESSURE_COLOURS)
    highest = max((float(peak.max()) for peak in series.peak.values()), default=0.0) / 1e3
    peak = series.peak.get(patch, np.zeros(len(places))) / 1e3
    return axes.scatter(
        places[:, 0], places[:, 1], c=peak, s=6.0 + 22.0 * peak / max(highest, 1e-9), cmap=colours, vmin=0.0,
        vmax=max(highest, 1.0), zorder=3, linewidths=0.0,
    )  # fmt: skip


def _draw_scale(figure: Figure, axes: Axes, dots: PathCollection) -> None:
    bar = figure.colorbar(dots, ax=axes, location="bottom", shrink=0.7, aspect=30)
    bar.set_label("largest pressure [kPa]", fontsize=7, color=INK)
    bar.ax.tick_params(labelsize=7, colors=PALE, length=2)
    bar.outline.set_visible(False)


def _outline(field: ReceptiveField) -> Array:
    """Returns points (60, 2) on the edge of a receptive field: theta [rad] and u.

    The distance from the centre of the field is measured along a straight line through the limb (eq. 6).
    """
    around = np.linspace(0.0, 2.0 * np.pi, 60)
    half = np.clip(field.radius * np.sin(around) / (2.0 * RHO), -1.0, 1.0)
    theta = field.theta + 2.0 * np.arcsin(half)
    return np.column_stack([theta, field.u + field.radius * np.cos(around)])


def _draw_latency(axes: Axes, series: Series) -> None:
    axes.set_title("after the first contact [ms]", loc="left")
    rows = series.touches[:8]
    marks = (("commanded", "command", "o", LINES[0]), ("moved", "motion", "s", LINES[1]))
    for row, touch in enumerate(rows):
        length = 1e3 * (touch.ended - touch.began)
        axes.barh(row, length, height=0.45, color="#d6dbe1", label="contact" if row == 0 else None)
        for name, label, marker, colour in marks:
            stamp = getattr(touch, name)
            if stamp is not None:
                after = 1e3 * (stamp - touch.began)
                axes.plot(after, row, marker, color=colour, markersize=5, label=label if row == 0 else None)
                axes.annotate(
                    f"{after:.0f}", (after, row), (0, 9), textcoords="offset points", ha="center", fontsize=7,
                    color=colour,
                )  # fmt: skip
        axes.annotate(
            f"{length:.0f}",
            (length, row),
            (3, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
            color=PALE,
        )
    axes.set_yticks(range(len(rows)), [f"{touch.began:.2f} s" for touch in rows])
    axes.set_ylim(max(len(rows), 3) + 0.5, -0.8)  # the last row is reserved for the legend
    axes.margins(x=0.15)
    if rows:
        axes.legend(loc="lower right", ncols=3, handlelength=1.0, columnspacing=1.0, handletextpad=0.5)
    else:
        axes.text(0.5, 0.5, "no touch", transform=axes.transAxes, ha="center", color=PALE)


def _plain(axes: Axes) -> None:
    axes.grid(visible=True, color=GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=7, colors=PALE, length=2)
    axes.yaxis.label.set(fontsize=7.5, color=INK)
    axes.xaxis.label.set(fontsize=7.5, color=INK)
    axes.set_title(axes.get_title(loc="left"), loc="left", fontsize=8, color=INK)
    for name, spine in axes.spines.items():
        spine.set(visible=name in ("left", "bottom"), color=GRID)
    for line in axes.lines:
        line.set_linewidth(1.1)
    legend = axes.get_legend()
    if legend is not None:
        legend.set_frame_on(False)
        for text in legend.get_texts():
            text.set(fontsize=6.5, color=INK)
