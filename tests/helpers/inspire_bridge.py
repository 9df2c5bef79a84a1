"""A stand-in of the maker's bridge of Inspire hands, with cyclonedds' own encoder and nothing of TCI: fields,
order and bounds from the vendor's description of its message.

python inspire_bridge.py DOMAIN l|r [given]

Taxel k says k % 4096. With `given`, each line of the standard input is one message: its pads are divided by
semicolons.

python inspire_bridge.py DOMAIN hands RATE

Both hands with angles that follow commands, at RATE [Hz]. Each line of the input changes what is sent, as
`{"l": {"angle_act": [...], "err": [...], "silent": true, "zeros": true}}`. Each command is printed, as
`["l", angles, mode, others]`.

python inspire_bridge.py DOMAIN client

The other end. Each line of the input, `["l", angles, mode]`, is written ten times as a command; an answer
tells the latest angles and taxels of this hand.
"""

import itertools
import json
import sys
import threading
import time
from typing import Any

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import byte, int8, int16, sequence
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

HERE = (
    "<CycloneDDS><Domain Id='any'><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
    "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
    "<Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)
SIZES = {
    f"finger{finger}_{pad}_touch": size
    for finger in ("one", "two", "three", "four")
    for pad, size in (("tip", 9), ("top", 96), ("palm", 80))
} | {
    "fingerfive_tip_touch": 9, "fingerfive_top_touch": 96, "fingerfive_middle_touch": 9,
    "fingerfive_palm_touch": 96, "palm_touch": 112,
}  # fmt: skip
FIELDS = [(name, sequence[int16, size]) for name, size in SIZES.items()]
WORDS, OCTETS = sequence[int16, 6], sequence[byte, 6]
STATE = {
    "pos_act": WORDS, "angle_act": WORDS, "force_act": WORDS, "current": WORDS, "err": OCTETS,
    "status": OCTETS, "temperature": OCTETS,
}  # fmt: skip
CTRL = {"pos_set": WORDS, "angle_set": WORDS, "force_set": WORDS, "speed_set": WORDS, "mode": int8}
SPEED = 1500
"""Largest speed of an angle [counts/s]."""


class Ends:
    """The topics of both hands."""

    def __init__(self, domain: int) -> None:
        self.kept = Domain(domain, HERE)
        self.participant = DomainParticipant(domain)
        self.kinds: dict[str, Any] = {
            what: final(make_idl_struct(f"inspire_hand_{what}", f"inspire.inspire_hand_{what}", members))
            for what, members in (("state", STATE), ("ctrl", CTRL), ("touch", dict(FIELDS)))
        }

    def topic(self, what: str, letter: str) -> Any:
        return Topic(self.participant, f"rt/inspire_hand/{what}/{letter}", self.kinds[what])

    def writer(self, what: str, letter: str) -> Any:
        return DataWriter(self.participant, self.topic(what, letter), qos=Qos(Policy.Reliability.Reliable(0)))

    def reader(self, what: str, letter: str) -> Any:
        return DataReader(self.participant, self.topic(what, letter))


def touch() -> dict[str, list[int]]:
    numbers = np.arange(sum(SIZES.values())) % 4096
    starts = np.cumsum([0, *SIZES.values()])
    return dict(zip(SIZES, [numbers[a:b].tolist() for a, b in itertools.pairwise(starts)], strict=True))


def hands(domain: int, rate: float) -> None:
    ends = Ends(domain)
    told: dict[str, dict[str, Any]] = {
        letter: {"angle_act": [1000] * 6, "err": [0] * 6, "silent": False, "zeros": False} for letter in "lr"
    }
    targets: dict[str, list[int]] = {}

    def listen() -> None:
        for line in sys.stdin:
            for letter, changed in json.loads(line).items():
                told[letter].update(changed)
                if "angle_act" in changed:
                    targets.pop(letter, None)

    threading.Thread(target=listen, daemon=True).start()
    states = {letter: ends.writer("state", letter) for letter in "lr"}
    touches = {letter: ends.writer("touch", letter) for letter in "lr"}
    commands = {letter: ends.reader("ctrl", letter) for letter in "lr"}
    felt = ends.kinds["touch"](**touch())
    print("ready", flush=True)
    while True:
        for letter, hand in told.items():
            for one in commands[letter].take(16):
                if type(one).__name__ != "inspire_hand_ctrl":
                    continue
                others = [*one.pos_set, *one.force_set, *one.speed_set]
                print(json.dumps([letter, [*one.angle_set], one.mode, others]), flush=True)
                targets[letter] = [*one.angle_set]
            most = SPEED / rate
            hand["angle_act"] = [
                round(now + min(max(goal - now, -most), most))
                for now, goal in zip(hand["angle_act"], targets.get(letter, hand["angle_act"]), strict=True)
            ]
            if not hand["silent"]:
                words = {name: [0] * 6 for name in STATE} | {
                    name: hand[name] for name in ("angle_act", "err")
                }
                if hand["zeros"]:
                    words["angle_act"] = [0] * 6
                states[letter].write(ends.kinds["state"](**words))
                touches[letter].write(felt)
        time.sleep(1.0 / rate)


def client(domain: int) -> None:
    ends = Ends(domain)
    states = {letter: ends.reader("state", letter) for letter in "lr"}
    touches = {letter: ends.reader("touch", letter) for letter in "lr"}
    writers = {letter: ends.writer("ctrl", letter) for letter in "lr"}
    print("ready", flush=True)
    for line in sys.stdin:
        letter, angles, mode = json.loads(line)
        for _ in range(10 if mode else 0):
            none = [0] * 6
            writers[letter].write(ends.kinds["ctrl"](none, angles, none, none, mode))
            time.sleep(0.05)
        found: dict[str, Any] = {}
        end = time.monotonic() + 10.0
        while len(found) < 2 and time.monotonic() < end:
            time.sleep(0.1)
            for what, readers in (("state", states), ("touch", touches)):
                for one in readers[letter].take(64):
                    if type(one).__name__ == f"inspire_hand_{what}":
                        found[what] = one
        values = [value for name in SIZES for value in getattr(found["touch"], name)]
        print(json.dumps([[*found["state"].angle_act], values]), flush=True)


def main(domain: int, letter: str, *, given: bool) -> None:
    kind: Any = final(make_idl_struct("inspire_hand_touch", "inspire.inspire_hand_touch", dict(FIELDS)))
    kept = Domain(domain, HERE)
    participant = DomainParticipant(domain)
    topic = Topic(participant, f"rt/inspire_hand/touch/{letter}", kind)
    writer = DataWriter(participant, topic, qos=Qos(Policy.Reliability.Reliable(0)))
    message = kind(**touch())
    print(len(message.serialize()), flush=True)
    while given:
        pads = [[*map(int, pad.split())] for pad in sys.stdin.readline().split(";")]
        writer.write(kind(**dict(zip(SIZES, pads, strict=True))))
    while kept is not None:
        writer.write(message)
        time.sleep(0.02)


if __name__ == "__main__":
    if sys.argv[2] == "hands":
        hands(int(sys.argv[1]), float(sys.argv[3]))
    if sys.argv[2] == "client":
        client(int(sys.argv[1]))
    main(int(sys.argv[1]), sys.argv[2], given=sys.argv[3:] == ["given"])
