"""Gestures: sequences of postures in generic joints.

They are recorded, or read from CSV and BVH files. The same gesture plays on any robot.
"""
