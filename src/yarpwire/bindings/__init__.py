"""YARP's network by YARP's own `yarp` bindings, where they can be imported.

module   the bindings: how they are found, and what they need of Python objects
port     a port of YARP's: reads, writes
calls    calls to somebody's port
network  all of it, as a driver asks for it
"""
