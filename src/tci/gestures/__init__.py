"""Gestures: sequences of postures in generic joints.

Gestures are recorded on a robot, or read from CSV and BVH files. A gesture can be played on any robot.
"""
