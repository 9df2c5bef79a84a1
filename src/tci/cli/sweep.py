"""`tci sweep`: thousands of touches of a simulated robot, on all cores, in shards, or on a cluster."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich import box

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.options import AsJson, RobotName
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.lab.sweeps.sweep import Result, Sweep

NOTED = {
    "no_room": "the hand did not get there", "went_back": "the gate led a part back",
    "refused": "a command was refused", "stopped": "the gate stopped the robot",
}  # fmt: skip
"""What is told below the table if it happened."""
FIGURES = ("hand_N", "felt_N", "reaction_s", "moved_deg")


def sweep(
    capability: Annotated[
        str,
        typer.Argument(
            help="Capability, as for tci run.",
            autocompletion=completion.capabilities,
        ),
    ],
    robot: RobotName,
    trials: Annotated[int, typer.Option(min=1, help="Touches.")] = 1000,
    kind: Annotated[
        list[str] | None, typer.Option(help="Kind of touch; repeat for several. \\[default: all]")
    ] = None,
    patch: Annotated[
        list[str] | None, typer.Option(help="Patch of skin to touch; repeat for several. \\[default: all]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all that is drawn.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder that keeps the trials. \\[default: out/sweep-CAPABILITY-ROBOT]"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help="Processes; on a cluster of each task. \\[default: one for each core, or 1]"
        ),
    ] = None,
    shard: Annotated[
        str | None, typer.Option(help="Do only this part, such as 3/64: the third of 64 equal ones.")
    ] = None,
    merge: Annotated[
        bool, typer.Option("--merge", help="Do nothing more: tell what all shards in --out found.")
    ] = False,
    cluster: Annotated[
        str | None,
        typer.Option(help="Run as an array of this scheduler: slurm, or local to try it without one."),
    ] = None,
    shards: Annotated[int, typer.Option(min=1, help="With --cluster: tasks of the array.")] = 64,
    minutes: Annotated[int, typer.Option(min=1, help="With --cluster: longest duration of a task.")] = 60,
    slurm: Annotated[
        list[str] | None,
        typer.Option(help="With --cluster slurm: KEY=VALUE, such as partition=short; repeat for several."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Touch a simulated ROBOT thousands of times while a capability runs, and tell what happened.

    Each trial is another person, kind of touch and place. What was done is kept: the same command again goes
    on where it ended. The numbers don't depend on the number of processes, shards or machines.

    Example:  tci sweep withdrawal nao --trials 200

    Example:  tci sweep withdrawal g1 --trials 20000 --shard 3/64

    Example:  tci sweep withdrawal g1 --trials 20000 --cluster slurm --slurm partition=short
    """
    from tci.lab.sweeps.sweep import Shard
    from tci.lab.sweeps.touch_trials import TouchTrials

    if sum((shard is not None, merge, cluster is not None)) > 1:
        raise CommandError("one of --shard, --merge and --cluster; none of them does everything here")
    named = f"sweep-{Path(capability).stem.replace(':', '-')}-{Path(robot).stem}"
    drawn = {} if kind is None else {"kinds": tuple(kind)}
    work = TouchTrials(capability, robot, **drawn, patches=tuple(patch or ()), seed=seed)
    asked = work.sweep((out or Path("out", named)).absolute(), trials)
    with told_here():
        if cluster is not None:
            options = dict(_pair(text) for text in slurm or ())
            _on_cluster(asked, cluster, shards, workers or 1, minutes, options, quiet=as_json)
        elif not merge:
            part = None if shard is None else Shard.parse(shard)
            try:
                _here(asked, part, workers, quiet=as_json)
            except KeyboardInterrupt:
                if not as_json:
                    console.print(_left(asked, len(asked.results())), highlight=False, markup=False)
                raise
    found = asked.results()
    if merge and len(found) < trials:
        lacking = f"{trials - len(found)} of {trials} trials are not in {asked.folder}"
        raise CommandError(f"{lacking}; valid: the shards that are missing, or without --merge")
    _tell(asked, found, whole=len(found) == trials, as_json=as_json)


def _pair(text: str) -> tuple[str, str]:
    key, sign, value = text.partition("=")
    if not sign or not key.isidentifier():
        raise CommandError(f"--slurm {text}; valid: KEY=VALUE, such as partition=short")
    return key, value


def _here(asked: Sweep, shard: Any, workers: int | None, *, quiet: bool) -> None:
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = *Progress.get_default_columns()[:-1], MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task("touches", total=None)
        asked.run(shard=shard, workers=workers,
                  progress=lambda done, of: bar.update(task, completed=done, total=of))  # fmt: skip


def _on_cluster(
    asked: Sweep, cluster: str, shards: int, workers: int, minutes: int, options: dict[str, str],
    *, quiet: bool,
) -> None:  # fmt: skip
    from rich.progress import MofNCompleteColumn, Progress

    from tci.lab.sweeps.cluster import submit

    def tell(words: str) -> None:
        if not quiet:
            console.print(words, style="dim", highlight=False, markup=False)

    array = submit(
        asked, shards, cluster=cluster, workers=workers, minutes=minutes, options=options, tell=tell
    )
    tell(f"{len(array.tasks)} tasks run as {array.name}; Ctrl-C leaves them running, and the same command "
         "with --merge in place of --cluster then tells what they found")  # fmt: skip
    columns = *Progress.get_default_columns()[:-1], MofNCompleteColumn()
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task("touches", total=None)
        array.wait(lambda done, of: bar.update(task, completed=done, total=of))


def _tell(asked: Sweep, found: Sequence[Result], *, whole: bool, as_json: bool) -> None:
    table = asked.folder / "trials.csv"
    if whole:
        with table.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(found[0]))
            writer.writeheader()
            writer.writerows(found)
    kinds = {kind: _summary([one for one in found if one["kind"] == kind])
             for kind in sorted({one["kind"] for one in found})}  # fmt: skip
    if as_json:
        print_json({"folder": str(asked.folder), "trials": len(found), "of": len(asked.jobs), "kinds": kinds})
        return
    _show(asked, kinds)
    console.print(
        f"all of them: {table}" if whole else _left(asked, len(found)), highlight=False, markup=False
    )


def _left(asked: Sweep, done: int) -> str:
    return f"{done} of {len(asked.jobs)} trials are done; the same command again goes on"


def _summary(found: Sequence[Result]) -> dict[str, Any]:
    """Counts, and medians and 95th percentiles of the trials for which a hand had room."""
    done = [one for one in found if not one["no_room"]]
    values = {name: [one[name] for one in done if one[name] is not None] for name in FIGURES}
    return {
        "trials": len(found),
        "no_room": len(found) - len(done),
        "felt": sum(one["felt_N"] > 0.0 for one in done),
        "answered": sum(one["moved_deg"] > 0.0 for one in done),
        "went_back": sum(one["went_back"] > 0 for one in done),
        "refused": sum(one["refused"] > 0 for one in done),
        "stopped": sum(one["state"] == "stop" for one in done),
        **{name: [float(np.quantile(those, share)) for share in (0.5, 0.95)] if those else None
           for name, those in values.items()},
    }  # fmt: skip


def _show(asked: Sweep, kinds: dict[str, dict[str, Any]]) -> None:
    from rich.table import Table

    work: Any = asked.work
    table = Table(
        title=f"{work.capability} on {work.robot}: touches of people who differ",
        caption="force: the largest on the person; reaction: from the first contact to a joint that has "
        "turned by a degree; way: of the joint that turned most; each median / 95th percentile",
        box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True,
    )  # fmt: skip
    table.add_column("kind")
    for name in ("trials", "felt", "moved", "force N", "reaction ms", "way degrees"):
        table.add_column(name, justify="right", no_wrap=True)
    for kind, one in kinds.items():
        figures = _both(one["hand_N"]), _both(one["reaction_s"], 1e3), _both(one["moved_deg"])
        table.add_row(kind, *(str(one[name]) for name in ("trials", "felt", "answered")), *figures)
    console.print(table)
    for name, words in NOTED.items():
        if count := sum(one[name] for one in kinds.values()):
            console.print(f"{words} in {count} trials", style="yellow", highlight=False)


def _both(values: Sequence[float] | None, scale: float = 1.0) -> str:
    return "" if values is None else " / ".join(f"{scale * value:.3g}" for value in values)
