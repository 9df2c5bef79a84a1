"""YARP's network through YARP's own `yarp` bindings, if they can be imported.

module   loading of the bindings, and conversions of Python objects for them
port     ports of YARP: reading and writing
calls    calls to other ports
network  the interface to all of these
"""
