"""DDS domains for tests that run side by side."""

from __future__ import annotations

import itertools
import os

_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
DOMAINS = itertools.count(100 + 40 * (_WORKER % 3))
"""Domains that no other test uses: those of ROS 2 are below, and each of three processes has 40."""
