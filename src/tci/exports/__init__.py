"""A robot in the forms that other libraries read.

Denavit-Hartenberg parameters, chains for OROCOS KDL, and URDF are made from its description. `facts` is
what a served robot answers to a query.
"""
