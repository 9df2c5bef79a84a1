"""Texts and colours of the page that describe a robot."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from html import escape

import numpy as np

from tci.capabilities.fields import ReceptiveField
from tci.gate.gate import GateState
from tci.lab.viewer.fields import OUTSIDE, is_outside
from tci.lab.viewer.view import View
from tci.messages import Contact
from tci.messages.frames import Array

COLOURS = {GateState.RUN: "#2b8a3e", GateState.HOLD: "#e8890c", GateState.STOP: "#c92a2a"}
GREY = "#868e96"
MEANING = {
    GateState.RUN: "commands pass, within limits",
    GateState.HOLD: "the robot keeps its position until the cause is gone",
    GateState.STOP: "the robot stays stopped until you reset it",
}
SIDES = ("flexor", "lateral", "extensor", "medial")


def badge(title: str, view: View | None, ended: str, loop: str = "", switches: Container[str] = ()) -> str:
    """The state of a robot's gate and loop as HTML. `switches` are the patches of switches."""
    if ended:
        colour, name, words = COLOURS[GateState.STOP], "LOOP ENDED", ended
    elif view is None:
        colour, name, words = GREY, "WAITING", "no data received yet"
    elif view.state is None:
        colour, name, words = GREY, "NOT COMMANDED", view.reason or "no command was sent to the robot"
    else:
        colour, name, words = COLOURS[view.state], view.state.name, view.reason or MEANING[view.state]
    touched = ", ".join(touch(contact, switches) for contact in view.contacts[:2]) if view else ""
    lines = [
        f'<b style="color:white;background:{colour};border-radius:4px;padding:1px 7px">{name}</b> '
        f"<b>{escape(title)}</b>",
        f'<span style="color:{colour}">{escape(words)}</span>',
        escape(touched or "no touch"),
    ]
    if loop:
        lines.append(f'<span style="color:{GREY}">{escape(loop)}</span>')
    return f'<div style="font-size:13px;line-height:1.45;padding:3px 12px">{"<br>".join(lines)}</div>'


def touched(contact: Contact, fields: Sequence[ReceptiveField], switches: Container[str] = ()) -> str:
    """Returns the text for a touch, such as `touched: left forearm, flexor side: 3.1 N`. If the touch is
    outside all fields, the text says so."""
    return f"{OUTSIDE if is_outside(fields, contact) else 'touched'}: {touch(contact, switches)}"


def touch(contact: Contact, switches: Container[str] = ()) -> str:
    """A contact as text: `left forearm, flexor side: 3.1 N`, or `head: pressed` on one of the patches
    `switches`, which don't tell how hard."""
    if contact.patch in switches:
        return f"{contact.patch.replace('_', ' ')}: pressed"
    if not np.isfinite(contact.theta):
        return f"{contact.patch.replace('_', ' ')}: {contact.force:.1f} N"
    side = SIDES[int(np.round(contact.theta / (np.pi / 2.0))) % 4]
    limb = contact.part.split("_")[0] + " " + contact.segment.replace("_", " ")
    return f"{limb}, {side} side: {contact.force:.1f} N"


def event_list(events: list[tuple[str, float, str]]) -> str:
    """Returns the latest events of all robots as HTML, the newest first."""
    rows = [
        f'<div><span style="color:{GREY}">{time:.2f} s {escape(robot)}</span> {escape(words)}</div>'
        for robot, time, words in events
    ]
    look = "font-size:12px;line-height:1.4;padding:3px 12px;height:8.4em;overflow-y:auto"
    return f'<div style="{look}">{"".join(rows) or "no events yet"}</div>'


def moves(part: str, values: Array) -> str:
    """Returns a command of generic angles [rad] as text: `left arm goes to 5, 25, 15, 40, 0 deg`."""
    degrees = np.rint(np.rad2deg(values)) + 0.0  # no -0
    return f"{part.replace('_', ' ')} goes to {', '.join(f'{angle:.0f}' for angle in degrees)} deg"


def without_numbers(note: str) -> str:
    """A note of which only forces and times differ from another one says nothing new."""
    return re.sub(r"\d+(\.\d+)?", "#", note)
