"""Figures of docs/touch-to-motion.md from simulated runs: the messages of one reflex, and the gate's
treatment of bad commands."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import tci
from tci.messages import PlatformCommand
from tci.messages.frames import Array

ROBOT, PATCH, TAXEL = "nao", "left_forearm", 150
LIGHT, DARK, ACCENT = "#f3f6f8", "#1d2733", "#c8452f"
LATER = 0.1
"""Time [s] after the first response at which the figure shows the motion again."""
ASKED = np.deg2rad(200.0)
"""Target angle [rad] of the bad command, which is beyond any limit of a NAO's shoulder."""
AT, NOT_FINITE = 0.1, 0.25
"""Times [s] of the two bad commands."""
plt.rcParams.update({"svg.hashsalt": "tci", "font.size": 10, "text.color": DARK})


def answer() -> tuple[tci.Robot, tci.Tick, tci.Tick]:
    """Returns the robot, the period of the reflex's first response, and the period `LATER` [s] after it."""
    ticks: list[tci.Tick] = []
    with tci.connect(ROBOT, "sim") as driver:
        driver.world.finger.poke(PATCH, TAXEL)
        tci.run(driver, tci.WithdrawalReflex(), duration=0.2, observe=ticks.append)
        first = next(tick for tick in ticks if tick.commands)
        later = next(tick for tick in ticks if tick.now >= first.now + LATER)
        return driver.robot, first, later


def steps(robot: tci.Robot, tick: tci.Tick, later: tci.Tick) -> list[tuple[str, str, str]]:
    """Returns name, source and values of each message in a period."""
    number = next(number for number, patch in enumerate(robot.patches) if patch.name == PATCH)
    frame = next(frame for frame in tick.reading.skin if frame.patch == PATCH)
    begin, end = tick.skin.begin[number : number + 2]
    active, pressure = tick.skin.active[begin:end], tick.skin.pressure[begin:end]
    strongest = int(active[pressure.argmax()])
    contact = tick.perception.contacts[0]
    command, sent = tick.commands[0], tick.sent
    posture = tick.perception.posture[command.part]
    target = command.values - posture
    servos = [robot.servos[index] for index in sent.servos]
    start = tick.reading.joints.position[sent.servos]
    now, then = np.rad2deg(sent.position - start), np.rad2deg(later.sent.position - start)
    (order,) = tick.sent.orders
    assert [*order.servos] == [*sent.servos]
    asked = np.rad2deg(order.values - start)
    most = int(np.abs(then).argmax())
    generic = ", ".join(f"{value:+.1f}" for value in np.rad2deg(target))
    servo = ", ".join(
        f"{servos[index].name} {asked[index]:+.1f}°" for index in np.argsort(-np.abs(asked))[:3]
    )
    turn = np.rad2deg(contact.theta)
    return [
        (
            "SkinFrame",
            "driver.read()",
            f"{PATCH}: {len(frame.values)} raw values at {tick.now:.3f} s\n"
            f"taxel {strongest} reads {frame.values[strongest]} counts",
        ),
        (
            "SkinState",
            "perceiver",
            f"{len(active)} active taxels of {len(frame.values)}\n"
            f"taxel {strongest}: {pressure.max() / 1e3:.1f} kPa",
        ),
        (
            "Contact",
            "perceiver, eq. 7",
            f"{contact.force:.2f} N on {1e4 * contact.area:.1f} cm², {contact.part}, {contact.segment}\n"
            f"u = {contact.u:.2f}, theta = {turn:.0f}°",
        ),
        (
            "GenericCommand",
            "capability, eqs. 5-6",
            f"{command.part}, {command.mode.value}: generic joints by\n{generic}°",
        ),
        (
            "PlatformCommand",
            "body.to_platform, eqs. 1-2",
            f"{len(servos)} servos of {robot.name}, those that move:\n{servo}",
        ),
        (
            "SafeCommand",
            "gate.step",
            f"{servos[most].name} {now[most]:+.4f}° in this period, jerk-limited;\n"
            f"{then[most]:+.1f}° after {1e3 * (later.now - tick.now):.0f} ms",
        ),
    ]


def draw_path(path: Path) -> None:
    """Draws the messages of one reflex from skin to servo, with their values in this run."""
    rows = steps(*answer())
    figure = Figure(figsize=(6.4, 1.0 * len(rows) + 0.2))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10), ylim=(-0.1, len(rows)))
    axes.axis("off")
    for index, (name, source, numbers) in enumerate(rows):
        low = len(rows) - 1 - index + 0.12
        axes.add_patch(
            plt.Rectangle((0.2, low), 9.6, 0.72, facecolor=LIGHT, edgecolor="#9aa7b4", linewidth=0.8)
        )
        axes.text(0.4, low + 0.45, name, weight="bold", va="center")
        axes.text(0.4, low + 0.18, source, fontsize=8, color="#5b6875", va="center")
        axes.text(3.6, low + 0.36, numbers, fontsize=9, va="center", linespacing=1.4)
        if index + 1 < len(rows):
            axes.annotate(
                "", (1.2, low - 0.27), (1.2, low), arrowprops={"arrowstyle": "-|>", "color": ACCENT}
            )
    figure.savefig(path, metadata={"Date": None})


def bad_command() -> tuple[Array, str, float, list[str]]:
    """Returns an array (n, 4) of time [s] and commanded, sent and measured angle [rad]; the servo's name; its
    upper limit [rad]; and the messages of the gate."""
    with tci.connect(ROBOT, "sim") as driver:
        robot = driver.robot
        servo = next(servo for servo in robot.servos if servo.name == "LShoulderPitch")
        asked, rows, said = np.nan, [], []
        for now in driver.ticks(duration=1.0):
            joints = driver.read().joints
            orders = ()
            for time, value in ((AT, ASKED), (NOT_FINITE, np.nan)):
                if time <= now < time + driver.period:
                    orders = (
                        PlatformCommand(
                            tci.Mode.POSITION,
                            np.array([servo.index]),
                            np.array([value]),
                            np.array([servo.limits.velocity]),
                        ),
                    )
                    asked = value if np.isfinite(value) else asked
            safe = driver.gate.step(orders, joints, now)
            said += map(str, (*safe.clamped, *safe.refusals))
            driver.write(safe)
            sent = safe.position[0] if len(safe.position) else np.nan
            rows.append((now, asked, sent, joints.position[servo.index]))
        return np.array(rows), servo.name, servo.limits.upper, said


def draw_bad_command(path: Path) -> None:
    """Draws the commanded and the sent values of a joint: angle and speed."""
    rows, name, upper, said = bad_command()
    print("\n".join(said))
    time, asked, sent, measured = rows.T
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    angle, speed = figure.subplots(2, 1, sharex=True)
    angle.plot(time, np.rad2deg(asked), color=ACCENT, linestyle="--", label="asked")
    angle.plot(time, np.rad2deg(sent), color=DARK, label="sent")
    angle.plot(time, np.rad2deg(measured), color="#4f86b8", linestyle=":", label="measured")
    angle.axhline(np.rad2deg(upper), color="#9aa7b4", linewidth=0.8)
    angle.text(0.0, np.rad2deg(upper), "limit", va="bottom", fontsize=8)
    angle.axvline(NOT_FINITE, color=ACCENT, linewidth=0.8)
    angle.text(NOT_FINITE + 0.01, 150, "asked: NaN, refused", fontsize=8, color=ACCENT)
    angle.set(ylabel=f"{name} [°]")
    angle.legend(fontsize=8, loc="lower right")
    speed.plot(time[1:], np.rad2deg(np.diff(sent) / np.diff(time)), color=DARK)
    speed.set(xlabel="time [s]", ylabel="speed sent [°/s]")
    figure.savefig(path, metadata={"Date": None})
