"""The command line, `tci`.

`main` registers the commands, and each is declared in the file of its name, with options that several share
in `options`. Heavy modules are imported inside functions, so that --help and completion are fast.
"""
