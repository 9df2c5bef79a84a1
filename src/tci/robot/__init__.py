"""One robot as data, and its kinematics.

A description (`description/`) is read from XML (`xml/`); the descriptions that come with TCI are in
`robots/`. Joint maps translate between generic joints and the robot's own joints (eqs. 1-2). Kinematics,
gravity torques and clearances are computed from the kinematic model that the description names.
"""
