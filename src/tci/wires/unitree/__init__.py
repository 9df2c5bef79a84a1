"""Driver and server for Unitree's robots, which communicate over the robots' own DDS topics."""
