"""Robotiq TSF-85, the tactile finger tips of a 2F-85 gripper, over USB."""
