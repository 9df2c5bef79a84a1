"""Readers of files with the positions of taxels. All of them return one type, `SkinLayout`
(docs/skin-files.md)."""
