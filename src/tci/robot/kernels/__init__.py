"""Compiled loops for the kinematics of links and limbs."""
