"""The generic body of one robot: readings become perceptions, generic commands become joint commands.

It answers questions about geometry: the place of a contact, how motions move it, the robot's stability.
Landmarks name places of the body on every robot.
"""
