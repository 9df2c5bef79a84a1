"""The protocol between two TCI processes: one owns the robot, others command it."""
