"""Simulated robots for learning: an environment for Gymnasium, and runs of many worlds.

The environment pokes one arm at random points, and the reward is larger for little harm, little effort and a
return to the task posture. The environment uses the same perception and the same gate as a real robot.
"""
