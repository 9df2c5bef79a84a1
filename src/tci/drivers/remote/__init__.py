"""The protocol between two TCI processes: one holds the robot, others command it."""
