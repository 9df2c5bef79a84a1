"""Simulated robots with skin, in MuJoCo.

A world holds one robot, its servos, its taxels and a finger that pokes it. Links reach it as they reach a
real robot.
"""
