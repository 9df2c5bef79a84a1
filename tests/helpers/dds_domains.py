"""DDS domains for tests that run at the same time."""

from __future__ import annotations

import itertools
import os

_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
DOMAINS = itertools.count(100 + 33 * (_WORKER % 4))
"""Domain numbers that no other test uses: the tests of ROS 2 use lower numbers, and each of four processes
has 33 numbers."""
LOOPBACK = (
    "<CycloneDDS><Domain id='any'><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
    "</Discovery></Domain></CycloneDDS>"
)
"""Configuration of cyclonedds (CYCLONEDDS_URI) for nodes that nobody outside this machine hears."""
