"""Readers of files with the positions of taxels. Each reader returns the type `SkinLayout`
(docs/skin-files.md)."""
