"""Compiled loops of kinematics and limbs."""
