"""Simulated robots for learning: a Gymnasium environment and plain rollouts.

The environment pokes one arm at random places and rewards little harm, little effort and a return to the
task. Each step is a period of the loop, with the same perception and gate as on a robot.
"""
