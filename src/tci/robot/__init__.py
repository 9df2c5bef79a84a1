"""One robot as data, and its kinematics.

A description (`description/`) is read from XML (`xml/`); those that come with TCI are in `robots/`. Joint
maps translate between generic joints and the robot's own (eqs. 1-2), and the kinematic model gives poses,
gravity torques and clearances.
"""
