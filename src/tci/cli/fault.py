"""`tci fault list`: prints the catalogue of faults. Each row has the expected reaction to a fault, and the
name of the fault for --fault."""

from __future__ import annotations

import typer

from tci.cli.options import AsJson

app = typer.Typer(
    help="List known faults, the expected reactions, and the names for --fault.",
    no_args_is_help=True,
)


@app.callback()
def fault() -> None:
    """Show known faults. Each fault has the expected reaction, the test of this reaction, and the name for
    --fault."""


@app.command("list")
def list_faults(
    as_json: AsJson = False,
) -> None:
    """List the known faults. To inject a fault that has a name: tci run ... --fault NAME@TIME."""
    from rich import box
    from rich.table import Table

    from tci.cli.console import console, print_json
    from tci.lab.faults.fault_list import FAULTS
    from tci.lab.faults.injectors import INJECTORS

    names = {number: [name for name, kind in INJECTORS.items() if kind.number == number] for number in FAULTS}
    if as_json:
        print_json(
            [
                {
                    "number": known.number,
                    "fault": known.fault,
                    "expected": known.expected,
                    "state": "open" if known.missing else "tested",
                    "test": known.test,
                    "missing": known.missing,
                    "injectors": {name: INJECTORS[name].description for name in names[known.number]},
                }
                for known in FAULTS.values()
            ]
        )
        return
    table = Table(title="Faults, and the reaction of TCI", box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("#", "fault", "expected reaction", "name", "state"):
        table.add_column(head, justify="right" if head == "#" else "left")
    for known in FAULTS.values():
        state = f"[yellow]open: {known.missing}[/]" if known.missing else "[green]tested[/]"
        table.add_row(str(known.number), known.fault, known.expected, "\n".join(names[known.number]), state)
    console.print(table)
    console.print("inject one:  tci run withdrawal nao --poke --fault stall@0.5")
