"""DDS domains for tests that run at the same time."""

from __future__ import annotations

import itertools
import os

_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
DOMAINS = itertools.count(100 + 33 * (_WORKER % 4))
"""Domain numbers that no other test uses: the tests of ROS 2 use lower numbers, and each of four processes
has 33 numbers."""
