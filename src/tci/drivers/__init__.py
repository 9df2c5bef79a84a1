"""Connections to a robot (Fig. 2, L2): simulated, replayed, or over a middleware.

Each is a `Driver`, in `driver`: it reads sensors and writes the commands that its gate approved. Servers make
a robot available to other programs, and `faults` injects faults into any driver.
"""
