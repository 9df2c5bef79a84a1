"""Tools that describe a robot and its skin.

The tools propose a description from a URDF, place taxels on surfaces, and calibrate a skin from touches. The
results are files to which a description refers.
"""
