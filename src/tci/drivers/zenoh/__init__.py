"""Zenoh: robots served and commanded over its sessions."""
