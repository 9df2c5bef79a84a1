"""The generic body of one robot: readings become perceptions, generic commands become joint commands.

It has methods for geometry: the place of a contact, its displacement by motions, and the robot's stability.
Landmarks define corresponding places of the body on all robots.
"""
