"""Ways to a robot (Fig. 2, L2): simulated, replayed, or over a middleware.

Each is a `Driver`, in `driver`: it reads sensors and writes what its gate approved. Servers show a robot to
other programs; `remote` is the protocol between two TCI processes, `faults` spoils any driver on purpose.
"""
