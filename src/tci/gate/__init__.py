"""The safety filter between commands and a robot: it passes nothing that violates a limit.

It checks each order, turns it into a jerk-limited motion and verifies that the robot can stop at any time. It
holds or stops when data is late, lost or wrong. Only a gate creates the `SafeCommand` that a driver writes.
"""
