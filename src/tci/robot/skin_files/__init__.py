"""Readers of files with the positions of taxels. All of them return the type `SkinLayout`
(docs/skin-files.md)."""
