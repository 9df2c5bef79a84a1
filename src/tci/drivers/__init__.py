"""Connections to a robot (Fig. 2, L2): simulated, replayed, or over a middleware.

Each connection is a `Driver` (module `driver`), which reads sensors and writes the commands that its gate
approved. Servers make a robot available to other programs, and `faults` injects faults into any driver.
"""
