"""The safety filter (the gate) between commands and a robot: the gate passes nothing that violates a limit.

The gate converts each command to a jerk-limited motion from which the robot can stop at any time, and stops
the robot if data is late, lost or wrong. Only a gate creates the `SafeCommand` that a driver writes.
"""
