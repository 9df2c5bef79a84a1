"""Simulated robots with skin, in MuJoCo.

A world contains one robot with its servos and taxels, and a simulated finger that pokes the robot. Drivers
connect to a world as to a real robot.
"""
