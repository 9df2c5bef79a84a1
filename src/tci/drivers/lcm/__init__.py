"""Robots that are served and commanded over LCM."""
