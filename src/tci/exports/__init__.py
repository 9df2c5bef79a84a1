"""Exports of a robot to the formats of other libraries.

Denavit-Hartenberg parameters, chains for OROCOS KDL and URDF are made from its description. `facts` holds the
answer of a served robot to a query.
"""
