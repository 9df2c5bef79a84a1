"""The control loop and its watchdogs.

`loop` reads, perceives, decides and writes once per period. Watchdogs, heartbeat and lease end the loop
safely; `serve` runs the loop for orders from other programs.
"""
