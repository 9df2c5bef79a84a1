"""A stand-in of the maker's bridge of Inspire hands, with cyclonedds' own encoder and nothing of TCI: fields,
order and bounds from the vendor's description of its message.

python inspire_bridge.py DOMAIN l|r [given]

Taxel k says k % 4096. With `given`, each line of the standard input is one message: its pads are divided by
semicolons.
"""

import itertools
import sys
import time
from typing import Any

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import int16, sequence
from cyclonedds.pub import DataWriter
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


def main(domain: int, letter: str, *, given: bool) -> None:
    kind: Any = final(make_idl_struct("inspire_hand_touch", "inspire.inspire_hand_touch", dict(FIELDS)))
    kept = Domain(domain, HERE)
    participant = DomainParticipant(domain)
    topic = Topic(participant, f"rt/inspire_hand/touch/{letter}", kind)
    writer = DataWriter(participant, topic, qos=Qos(Policy.Reliability.Reliable(0)))
    numbers = np.arange(sum(SIZES.values())) % 4096
    starts = np.cumsum([0, *SIZES.values()])
    parts = [numbers[a:b].tolist() for a, b in itertools.pairwise(starts)]
    message = kind(**dict(zip(SIZES, parts, strict=True)))
    print(len(message.serialize()), flush=True)
    while given:
        pads = [[*map(int, pad.split())] for pad in sys.stdin.readline().split(";")]
        writer.write(kind(**dict(zip(SIZES, pads, strict=True))))
    while kept is not None:
        writer.write(message)
        time.sleep(0.02)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], given=sys.argv[3:] == ["given"])
