"""Exports of a robot to the formats of other libraries.

Denavit-Hartenberg parameters, chains for OROCOS KDL and URDF are computed from its description. `facts`
defines the reply of a served robot to a query.
"""
