"""Driver and server for Unitree's robots over the robots' own DDS topics."""
