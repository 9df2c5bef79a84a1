"""Findings of `tci doctor` about a robot on YARP."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import closing
from typing import Any

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.errors import DriverError, MissingExtraError, TciError, UnknownNameError
from tci.robot.description import Robot, wire_name
from tci.wires.yarp import address as addresses
from tci.wires.yarp.address import board_ports, patch_port
from tci.wires.yarp.axes import Axes, find_axes
from tci.wires.yarp.board_driver import BoardDriver
from tci.wires.yarp.skin_layout import SkinLayout, check_order
from tci.wires.yarp.skin_ports import skin_port
from yarpwire.bindings.module import importable
from yarpwire.board import find_board
from yarpwire.dialect import Dialect
from yarpwire.errors import YarpError
from yarpwire.feed import Feed
from yarpwire.network import Network

NEAR = 0.5
"""Largest difference [deg] between two joint limits that count as equal. Assumed: robots' configuration files
round limits to a degree."""


def probe(robot: Robot, address: str) -> tuple[Finding, ...]:
    """Checks step by step if library, name server, control boards and skin ports can be reached.

    Adds a finding for each step that fails. Never raises a TciError.
    """
    try:
        options = addresses.parse(address)
        patches = options.patches(robot)
        network = options.network()
    except MissingExtraError as error:
        return (Finding(Level.FAULT, "YARP library", str(error)),)
    except UnknownNameError as error:
        return (Finding(Level.FAULT, "address", str(error)),)
    except TciError as error:
        return (_no_server(error),)
    try:
        count = len(network.list())
    except YarpError as error:
        return _library(network), _no_server(error)
    host, port = network.address
    found = [_library(network)]
    found += [Finding(Level.OK, "name server", f"{host}:{port} has {count} ports")]
    prefix = options.robot or wire_name(robot.name)
    dialect = spoken = options.dialect or network.dialect
    for part, where in board_ports(robot, prefix).items():
        try:
            with closing(
                find_board(network, where, f"/tci/{os.getpid()}/probe/{wire_name(part)}", dialect)
            ) as board:
                axes = find_axes(board, robot.servos_of(part))
        except YarpError as error:
            advice = "start its device (yarprobotinterface), or name the robot: --via yarp:...,robot=NAME"
            found.append(Finding(Level.FAULT, part, str(error), advice))
            continue
        except DriverError as error:
            found.append(Finding(Level.FAULT, part, str(error)))
            continue
        spoken = board.dialect
        text = f"a control board of YARP {board.dialect.name}, {len(axes.names)} axes"
        found += [Finding(Level.OK, part, text), *_absent(part, axes)]
    for patch in patches:
        name = patch_port(robot, prefix, patch.name)
        advice = f"leave it out: --via yarp:...,without={patch.name}"
        try:
            read = skin_port(name, spoken, network, compensated=options.skin == "comp")
            if not network.lives(read):
                raise DriverError(f"no port {read} answers")
            check_order(SkinLayout.of(robot, patch), patch, prefix, network)
        except DriverError as error:
            found.append(Finding(Level.FAULT, patch.name, str(error), advice))
        except YarpError as error:
            return *found, _no_server(error)
    return tuple(found)


def _absent(part: str, axes: Axes) -> list[Finding]:
    """Returns a list with one finding about the servos for which a board has no axis. The list is empty if
    every servo has an axis."""
    if not axes.absent:
        return []
    what = f"the board has no axis of {', '.join(servo.name for servo in axes.absent)}"
    return [Finding(Level.NOTE, part, what, "they count as still: commands to them are refused")]


def _library(network: Network) -> Finding:
    bindings = importable()
    also = f"; {bindings or 'no bindings of YARP'} can be imported"
    text = network.title + ("" if network.title == bindings else also)
    return Finding(Level.OK, "YARP library", text, figures={"library": network.title, "bindings": bindings})


def _no_server(error: Exception) -> Finding:
    advice = "start yarpserver, or give its address: --via yarp:HOST:PORT; see docs/yarp.md"
    return Finding(Level.FAULT, "name server", str(error), advice)


def examine(
    dialect: Dialect, boards: Mapping[str, BoardDriver], skin: Mapping[str, Feed[Any]]
) -> tuple[Finding, ...]:
    """Returns findings about a connected robot.

    The findings are about the dialect, joints and limits that differ from the description, lost and invalid
    messages, and offsets of clocks. Raises DriverError if a board does not answer.
    """
    found = [Finding(Level.OK, "dialect", f"YARP {dialect.name}", figures={"dialect": dialect.name})]
    for part, board in boards.items():
        found += _examine_board(part, board)
    feeds: dict[str, Feed[Any]] = {
        part: board.feed for part, board in boards.items() if board.feed is not None
    }
    for name, feed in {**feeds, **skin}.items():
        error = feed.last_error or feed.port.last_error
        level = Level.WARNING if feed.wrong or feed.lost or error else Level.OK
        what = f"{feed.lost} messages lost, {feed.wrong} invalid"
        advice = error or ("use a faster carrier or network: yarp:...,carrier=fast_tcp" if feed.lost else "")
        figures: dict[str, float | str] = {"lost": feed.lost, "wrong": feed.wrong}
        if feed.clock is not None and feed.clock.difference is not None:
            figures["clock_offset_s"] = feed.clock.difference
        found.append(Finding(level, name, what, advice if level is not Level.OK else "", figures=figures))
    return tuple(found)


def _examine_board(part: str, board: BoardDriver) -> list[Finding]:
    axes = board.axes
    found = _absent(part, axes)
    foreign = [axes.names[axis] for servo, axis in zip(axes.servos, axes.numbers, strict=True)
               if axes.names[axis] != servo.name]  # fmt: skip
    if len(foreign) == len(axes.servos) > 1:
        what = f"none of its {len(foreign)} axes has a name of the description; the first is {foreign[0]!r}"
        advice = "another robot or part? Compare its names, then each joint: tci check --hardware"
        found.append(Finding(Level.WARNING, part, what, advice))
        foreign = []
    for servo, axis, limits in zip(axes.servos, axes.numbers, board.limits(), strict=True):
        if axes.names[axis] in foreign:
            what = f"the board's name of its axis {axis} is {axes.names[axis]!r}"
            found.append(Finding(Level.NOTE, servo.name, what, "found by its number: check it on the robot"))
        ours = (servo.limits.lower, servo.limits.upper)
        if ours[0] is None or ours[1] is None:
            continue
        lower, upper = np.rad2deg(np.array(ours))
        if limits.lower > lower + NEAR or limits.upper < upper - NEAR:
            what = (
                f"the board allows {limits.lower:g} to {limits.upper:g} degrees, "
                f"the description {lower:g} to {upper:g}"
            )
            advice = "put the board's limits into the description: the board clips set-points beyond them"
            figures = {"lower_deg": limits.lower, "upper_deg": limits.upper}
            found.append(Finding(Level.WARNING, servo.name, what, advice, figures=figures))
    if not found:
        found.append(Finding(Level.OK, part, f"{len(axes.servos)} joints, names and limits as described"))
    return found
