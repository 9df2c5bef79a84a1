"""The safety filter between a command and a robot: nothing passes that a limit forbids.

It judges each order, turns it into a jerk-limited motion and checks that the robot can stop at any time. It
holds or stops when data is late, lost or wrong. Only a gate makes the `SafeCommand` that a link sends.
"""
