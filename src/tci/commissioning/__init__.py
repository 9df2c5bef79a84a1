"""Commissioning: from a new robot to its first touch.

The doctor finds faults of a machine and a robot. The first minutes check directions, limits and skin with one
small motion after another.
"""
