"""Commissioning: from a new robot to its first touch.

`tci doctor` finds faults of a machine and a robot. The check of the first minutes moves one joint after
another a little, and compares directions, limits and skin with the description.
"""
