"""The generic body of one robot: readings become perceptions, generic commands become joint commands.

It answers questions about geometry: where a contact is, how a motion moves it, what carries the robot.
Landmarks name places of the body on every robot.
"""
