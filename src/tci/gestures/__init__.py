"""Sequences of postures, in generic joints: recorded, read from files, given to any robot."""
