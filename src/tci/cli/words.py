"""`tci words`: which touch words a robot can tell, and a recogniser trained on your own recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tci.cli.options import AsJson, RobotName
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.lab.words.examples import Examples

app = typer.Typer(help="Touches told as words: which ones, and trained anew.", no_args_is_help=True)
RecogniserFile = Annotated[
    Path | None, typer.Option(help="Recogniser that was trained anew. \\[default: TCI's]")
]


@app.command()
def show(robot: RobotName, recogniser: RecogniserFile = None, as_json: AsJson = False) -> None:
    """List the words that each patch of ROBOT can tell. Skin with few channels has fewer words.

    Example:  tci words show nao-plain
    """
    from tci.body.generic_body import GenericBody
    from tci.capabilities.touch_words.capability import TouchWords
    from tci.cli.console import console, print_json

    listener, body = TouchWords(str(recogniser or "")), GenericBody(robot)
    words = {patch.name: listener.words_on(patch.name, body) for patch in body.robot.patches}
    if as_json:
        print_json({"robot": body.robot.name, "words": words})
        return
    alike: dict[tuple[str, ...], list[str]] = {}
    for patch, known in words.items():
        alike.setdefault(known, []).append(patch)
    for known, patches in alike.items():
        console.print(f"{', '.join(patches)}: {', '.join(known)}", highlight=False, markup=False)
    console.print("everything else is told as other", highlight=False, markup=False)


@app.command()
def train(
    file: Annotated[Path, typer.Argument(help="New file of the recogniser (.npz).")],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Recordings (.mcap), each with its labels beside it: NAME.tsv, or of BORIS or ELAN."
        ),
    ] = None,
    laid: Annotated[
        list[str] | None,
        typer.Option(help="Add simulated touches, laid on this robot's skin; may be given several times."),
    ] = None,
    each: Annotated[int, typer.Option(min=1, help="With --laid: touches of each kind.")] = 100,
    seed: Annotated[int, typer.Option(help="Of the training and of the laid touches.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Train the recogniser of touch words on your own recordings.

    A label is a kind of touch with its onset and duration, as tci log touches writes it; correct the kinds in
    that file. A touch without a label is told as other. With several files, each is also left out once, and
    what is told of it is printed: only this says how good the recogniser is.

    Example:  tci words train mine.npz monday.mcap tuesday.mcap
    """
    from tci.cli.console import console, print_json
    from tci.lab.words.examples import of_laid, of_recording
    from tci.lab.words.training import left_out, train

    if file.suffix.lower() != ".npz" or not file.parent.is_dir():
        raise CommandError(f"{file} can't hold a recogniser; valid: a .npz file in a folder that exists")
    if file.exists():
        raise CommandError(f"{file} exists; valid: a new file")
    parts = [of_recording(path) for path in recordings or ()]
    parts += [of_laid(name, each, seed=seed) for name in laid or ()]
    if not parts:
        raise CommandError("nothing to train on; valid: recordings with labels, or --laid ROBOT")
    every = sum(parts[1:], parts[0])
    words = tuple(every.counts)
    if len(words) < 2:
        raise CommandError(f"only {', '.join(words)}; valid: touches of two words at least")
    train(every.features, every.words, words, trained_on=every.about, seed=seed).save(file)
    scores = left_out(every, seed=seed)
    if as_json:
        print_json({"file": str(file), "touches": every.counts, "right_when_left_out": scores})
        return
    counts = ", ".join(f"{count} {word}" for word, count in every.counts.items())
    console.print(f"{file}: trained on {counts}", highlight=False, markup=False)
    for group, score in scores.items():
        console.print(f"{group} left out: {100 * score:.0f} % right", highlight=False, markup=False)
    if not scores:
        console.print(_advice(every), style="yellow", highlight=False, markup=False)


@app.command()
def score(
    corpus: Annotated[Path, typer.Argument(help="CoST.csv, as its authors publish it.")],
    seed: Annotated[int, typer.Option(help="Of the training.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Measure the recogniser on real people: CoST, with each person left out of the training in turn.

    Takes some minutes. Published recognisers tell about 60 % of its 14 gestures.

    Example:  tci words score CoST.csv
    """
    from tci.cli.console import console, print_json
    from tci.lab.words.cost import read_cost
    from tci.lab.words.training import left_out

    found = read_cost(corpus)
    people = left_out(found, seed=seed)
    counts = {name: found.groups.count(name) for name in people}
    right = sum(people[name] * counts[name] for name in people) / max(sum(counts.values()), 1)
    if as_json:
        print_json({"corpus": str(corpus), "touches": len(found.words), "people": people, "right": right})
        return
    told = (
        f"{corpus}: {100 * right:.0f} % of {len(found.words)} touches of {len(people)} people are told right"
    )
    console.print(told, highlight=False, markup=False)


def _advice(every: Examples) -> str:
    why = f"all from {every.groups[0]}"
    if len({*every.groups}) > 1:
        why = "without any one of these files no two words are left"
    return f"{why}: how good it is elsewhere, nobody knows; give another recording, with several words"
