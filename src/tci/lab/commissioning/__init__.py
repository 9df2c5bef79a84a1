"""Commissioning of a new robot until the first touch. `tci doctor` finds faults of a machine and of a robot.
`tci check --hardware` moves one joint after another by a small angle, and compares directions, limits and
skin with the description.
"""
