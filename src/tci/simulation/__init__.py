"""Simulated robots with skin, in MuJoCo.

A world holds one robot, its servos, its taxels and a finger that pokes it. Drivers connect to it as to a real
robot.
"""
