"""Exports of a robot's model for other libraries.

The modules compute Denavit-Hartenberg parameters, chains for OROCOS KDL and URDF from a robot's description.
`facts` defines the data with which a served robot answers a query.
"""
