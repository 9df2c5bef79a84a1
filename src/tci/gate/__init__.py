"""What stands between a command and a robot: nothing passes that a limit forbids."""
