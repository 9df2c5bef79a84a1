"""Gestures: sequences of postures in generic joints.

They are recorded, or read from CSV and BVH files. One gesture can be played on any robot.
"""
