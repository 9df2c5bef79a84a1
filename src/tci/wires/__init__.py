"""Connections over a middleware: one folder, one extra, entry points in `tci.drivers` and `tci.servers`.

A wire imports the core and `shared`, never another wire.
"""
