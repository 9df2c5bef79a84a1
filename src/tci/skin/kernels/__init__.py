"""Compiled stages of perception (numba). Each is tested against a plain NumPy twin."""
