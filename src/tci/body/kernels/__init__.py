"""Compiled loops of the generic body."""
