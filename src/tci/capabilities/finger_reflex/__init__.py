"""Pads on fingers: a pressed hand lets go, a touched palm holds."""
