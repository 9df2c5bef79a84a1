"""The control loop and its watchdogs.

`loop` reads, perceives, decides and writes once per control period. Watchdogs, heartbeat and lease bring the
robot to rest if something fails, and `serve` runs the loop for orders from other programs.
"""
