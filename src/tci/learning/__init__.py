"""Simulated robots for learning: a Gymnasium environment and plain rollouts.

Each step is a period of the loop, with the same perception and gate as on a robot.
"""
