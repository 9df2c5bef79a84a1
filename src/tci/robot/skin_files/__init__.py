"""Files that say where taxels are, in every format, as one layout (docs/skin-files.md)."""
