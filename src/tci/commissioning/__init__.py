"""Commissioning: from a new robot to its first touch.

The doctor lists faults of a machine and a robot. The first minutes check directions, limits and skin with
small motions, one after another.
"""
