"""Lists the commands to try first, and for each command the next command to try. The help text of each
command ends with the next command."""

import os
import shutil
import sys

FIRST = (
    ("tci demo", "poke simulated robots, with a table, a picture and a report"),
    ("tci view", "poke simulated robots yourself, in the browser"),
    ("tci run withdrawal nao --poke", "run the withdrawal reflex and print each decision"),
    ("tci doctor", "find faults of this machine, such as missing libraries"),
)
"""Commands to try first, each with the purpose of the command. These commands need no real robot."""

NEXT = {
    "demo": "tci view",
    "view": "tci run withdrawal nao --poke",
    "run": "tci run withdrawal nao --poke --duration 2 --record touch.mcap",
    "record": "tci log info touch.mcap",
    "serve": "tci run withdrawal nao --via zenoh --arm",
    "plot": "tci view --via replay:touch.mcap",
    "film": "tci plot touch.mcap",
    "robots": "tci describe nao",
    "describe": "tci check nao --simulate",
    "new-robot": "tci check robot.xml --simulate",
    "touch": "tci touches nao",
    "touches": "tci run withdrawal nao --touch \"stroke 'left forearm' 3N 8cm/s\"",
    "check": "tci run withdrawal nao --poke",
    "safety": "tci check nao --simulate",
    "sweep": "tci run withdrawal nao --touch \"stroke 'left forearm' 3N 8cm/s\"",
    "doctor": "tci demo",
    "hand": "tci robots",
    "skin find": "tci new-robot my_robot.urdf",
    "skin fit": "tci skin show icub",
    "skin check": "tci skin show icub",
    "skin mount": "tci skin locate nao --patch left_forearm",
    "skin locate": "tci skin check icub",
    "skin calibrate": "tci doctor nao",
    "skin export": "tci skin find g1-inspire_skin.xml",
    "skin show": "tci skin fit icub",
    "fault list": "tci demo --fault stall@0.32",
    "gesture record": "tci gesture play wave.csv icub",
    "gesture convert": "tci gesture play wave.csv nao",
    "gesture field": "tci run people.toml nao --touch \"poke 'left forearm outside'\"",
    "gesture play": "tci gesture play wave.csv icub --reflex",
    "log info": "tci plot touch.mcap",
    "log cut": "tci plot poke.mcap",
    "log touches": "tci run withdrawal g1 --touches touches.tsv",
    "log export": "tci plot touch.mcap",
    "log import": "tci log info touches.mcap",
    "words show": "tci run touch-words nao --touch \"pat 'left forearm'\"",
    "words score": "tci words train mine.npz visit.mcap",
    "words train": "tci words show nao",
    "zenoh secure": "tci zenoh router keys/router.json5",
    "zenoh router": "tci serve nao --via zenoh",
}
"""Command to try next, by the name of the command that the user has run."""


def next_command(after: str) -> str:
    """Returns the command to try after the command `after`. If the shell does not find `tci`, the result also
    contains the command that activates the Python environment."""
    if shutil.which("tci"):
        return NEXT[after]
    folder = os.path.relpath(os.path.join(sys.prefix, "bin", "activate"))
    return f"source {folder}; {NEXT[after]}"


def first_steps() -> str:
    """Returns the text that `tci` without arguments prints."""
    width = max(len(command) for command, _ in FIRST)
    return "\n".join(
        [
            "TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any robot with "
            "skin.",
            "",
            "Try first:",
            *(f"  {command:<{width}}  {purpose}" for command, purpose in FIRST),
            "",
            "All commands: tci --help. Help for one: tci COMMAND --help.",
            "This is software, not a certified safety function.",
        ]
    )
