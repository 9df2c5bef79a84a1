"""Exports of a robot's model for other libraries.

From a robot's description, the modules compute Denavit-Hartenberg parameters, a URDF, and chains for OROCOS
KDL. `facts` defines the data with which a served robot answers a query.
"""
