"""YARP's network through YARP's own `yarp` bindings, if they can be imported.

- `module` loads the bindings, and converts Python objects for them.
- `port` reads and writes with ports of YARP.
- `calls` makes calls to other ports.
- `network` is the interface to `port` and `calls`.
"""
