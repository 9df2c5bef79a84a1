"""Compiled loops of the gate."""
