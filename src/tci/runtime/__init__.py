"""The control loop and its watchdogs.

Once per control period, `loop` reads the sensors, runs the capability and writes the checked commands to the
robot. Watchdogs and heartbeat bring the robot to rest after a failure, and `serve` runs the loop for
orders from other programs.
"""
