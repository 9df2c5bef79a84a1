"""Unitree's robots over their own DDS topics."""
