"""Readers of files with the positions of taxels: every format gives the same layout (docs/skin-files.md)."""
