"""Tools that describe a robot and its skin.

They propose a description from a URDF, place taxels on surfaces, and calibrate a skin by touches. Their
results are files that a description refers to.
"""
