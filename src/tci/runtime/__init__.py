"""The control loop and its watchdogs.

`loop` reads, perceives, decides and writes once per period. Watchdogs, heartbeat and lease end it safely;
`serve` runs it for orders that come from other programs.
"""
