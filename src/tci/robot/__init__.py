"""The description of one robot, and its kinematics.

A description (`description/`) is read from an XML file (`xml/`); TCI's own descriptions are in `robots/`.
Joint maps convert between generic joints and the joints of the robot (eqs. 1-2), and poses, gravity torques
and clearances are computed from the kinematic model.
"""
