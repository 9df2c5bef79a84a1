"""Commissioning: from a new robot to its first touch.

The doctor finds faults of a machine and a robot. The first minutes check directions, limits and skin by small
motions of one joint after another.
"""
