"""The safety filter between commands and a robot: it passes nothing that violates a limit.

It converts each order to a jerk-limited motion from which the robot can stop at any time, and holds or stops
when data is late, lost or wrong. Only a gate creates the `SafeCommand` that a driver writes.
"""
