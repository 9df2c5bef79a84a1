"""Settings of all tests. At the end of a run, tests that did not run are listed with advice on how to run
them."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

from made_recordings import write_recordings
from made_skins import write_skins
from skin_data import SkinData

TESTS = Path(__file__).parent

LIVE = [
    "cli",
    "commissioning",
    "drivers",
    "exports/test_facts.py",
    "faults/test_processes.py",
    "recording/test_recorder.py",
    "runtime",
    "test_examples.py",
    "experiments/test_remote_trial.py",
    "viewer",
    "yarpwire",
]
"""Folders and files of live tests, which use other processes in real time. On a busy machine the gate
correctly holds the robot, so only few of these tests run at the same time."""

FIRST = ["test_wheel.py", "viewer"]
"""Longest groups of each half of `make test`. They start first, because at the end of the run the other
processors would wait for them."""
