"""Machinery that no other folder explains: compiled loops and their cache, extras, the physics engine."""
