"""Experiments whose results `tci demo` and `tci check` print.

Each experiment pokes simulated robots at known points of the skin, with and without a reflex, and measures
the robots' responses. The module `checker` compares every sent command with the limits in the robot's
description, and does not use any code of the gate.
"""
