"""Simulated robots for learning: an environment for Gymnasium, and runs of many worlds.

The environment pokes one arm at random points; harm, effort and distance from the task posture reduce the
reward. The environment uses the same perception and the same gate as a real robot.
"""
