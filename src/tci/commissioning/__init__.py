"""From a new robot to its first touch.

The doctor says what a machine and a robot lack. The first minutes check directions, limits and skin with
small motions, one after the other.
"""
