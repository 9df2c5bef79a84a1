"""Protocol between TCI processes. One process owns the robot, and other processes send orders for the robot
to this process."""
