"""One robot as data, and its kinematics.

A description (`description/`) is read from XML (`xml/`); TCI's own descriptions are in `robots/`. Joint maps
convert between generic joints and the robot's own (eqs. 1-2), and the kinematic model is used to compute
poses, gravity torques and clearances.
"""
