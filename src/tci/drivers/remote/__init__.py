"""The protocol between TCI processes: one process owns the robot, other processes command the robot."""
