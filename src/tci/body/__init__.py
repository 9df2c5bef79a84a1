"""The generic body of one robot: readings become perceptions, generic commands become joint commands.

The generic body also has methods for geometry: the place of a contact, the displacement of a contact by a
motion, and the stability of the robot. Landmarks define corresponding places on the bodies of all robots.
"""
