"""Making descriptions: proposing a robot, placing and calibrating its skin."""
