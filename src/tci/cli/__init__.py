"""The command line, `tci`.

The file `main` registers the commands, each of which is declared in the file of its name, and `options`
declares options that several commands share. Large modules are imported inside functions, so that --help and
completion are fast.
"""
