"""Compiled inner loops (numba). Each has a plain NumPy twin in the tests that it must equal."""
