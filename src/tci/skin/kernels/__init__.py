"""Compiled stages of perception (Numba). Tests compare each stage with a version in NumPy."""
