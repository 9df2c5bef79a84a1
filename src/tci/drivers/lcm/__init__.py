"""LCM: robots served and commanded over its datagrams."""
