"""`tci touches`: lists the kinds of touches and the places of a robot, and measures what it feels of them."""

from __future__ import annotations

from typing import Annotated

import typer
from rich import box

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, OptionalRobot
from tci.errors import CommandError


def touches(
    robot: OptionalRobot = None,
    measure: Annotated[
        bool,
        typer.Option(
            "--measure",
            help="Do each kind of touch in simulation, and compare what ROBOT feels with what the hand did.",
        ),
    ] = False,
    place: Annotated[str, typer.Option(help="With --measure: where to touch.")] = "left forearm",
    as_json: AsJson = False,
) -> None:
    """List the kinds of touches, and the places of ROBOT that have skin.

    The words are those of tci run --touch and of the files for tci run --touches.

    Example:  tci touches nao

    Example:  tci touches nao --measure
    """
    if measure:
        if robot is None:
            raise CommandError("--measure needs a robot; valid: tci touches ROBOT --measure")
        _measure(robot, place, as_json=as_json)
    else:
        _list(robot, as_json=as_json)


def _list(robot: str | None, *, as_json: bool) -> None:
    from rich.table import Table

    from tci.touches.kinds import KINDS

    places = {} if robot is None else _places(robot)
    if as_json:
        kinds = {
            kind.name: {
                "definition": kind.definition, "generator": kind.generator, "force_N": kind.force_N,
                "cost": kind.cost, "haart": kind.haart, "vr": kind.vr, "touch_dictionary": kind.dictionary,
            }
            for kind in KINDS.values()
        }  # fmt: skip
        print_json({"kinds": kinds, **places})
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("kind", "force", "what it is"):
        table.add_column(name, justify="right" if name == "force" else "left")
    for kind in KINDS.values():
        low, high = kind.force_N
        able = "" if kind.generator != "none" else "  (TCI knows the word, but can't do it)"
        table.add_row(kind.name, f"{low:g} to {high:g} N", kind.definition + able)
    console.print(table)
    for title, words in places.items():
        console.print(
            f"{title.replace('_', ' ')}: {', '.join(words) or 'none'}", highlight=False, markup=False
        )


def _places(name: str) -> dict[str, list[str]]:
    from tci.body.generic_body import GenericBody
    from tci.body.touchable import without_skin
    from tci.touches.places import place_words

    body = GenericBody(name)
    return {
        "places": list(dict.fromkeys(place_words(body))),
        "patches": [patch.name for patch in body.robot.patches],
        "parts_without_skin": list(without_skin(body.robot)),
    }


def _measure(robot: str, place: str, *, as_json: bool) -> None:
    from rich.table import Table

    from tci.lab.experiments.felt_touches import measure_touches

    rows = list(measure_touches(robot, place=place))
    if as_json:
        print_json({"touches": [row.to_json() for row in rows]})
        return
    table = Table(
        title=f"{place} of {robot}: what was asked, what the hand did, what was felt",
        caption="asked, hand, felt: median force, of blows the peak. place: distance of the felt from the "
        "true centre. speed: of the hand, and as felt. laid: felt of the same touch without physics, and how "
        "far that is from where the hand was felt. on taxels: of the laid pressure.",
        box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True,
    )  # fmt: skip
    table.add_column("kind")
    for name in ("asked\nN", "hand\nN", "felt\nN", "place\nmm", "speed\ncm/s", "felt\ncm/s", "laid\nN",
                 "laid\nmm", "on\ntaxels"):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        numbers = (
            row.asked_n, row.hand_n, row.felt_n, row.place_mm, row.hand_cm_s, row.felt_cm_s,
            row.laid_n, row.laid_mm,
        )  # fmt: skip
        shown = ("" if number is None else f"{number:.1f}" for number in numbers)
        table.add_row(row.kind, *shown, f"{100 * row.on_taxels:.0f} %")
    console.print(table)
    for row in rows:
        if row.note:
            console.print(
                f"{row.kind} was not done: {row.note}", style="yellow", highlight=False, markup=False
            )
