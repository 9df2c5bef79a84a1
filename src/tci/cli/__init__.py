"""The command line, `tci`.

`main` registers the commands; each is declared in the file of its name, and `options` declares options that
several commands share. Large modules are imported inside functions, so that --help and completion are fast.
"""
