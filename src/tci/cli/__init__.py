"""The command line, `tci`.

The module `main` registers the commands, each command has a module of the same name, and `options` declares
the options that several commands share. The functions of the commands import large modules, so that --help
and completion are fast.
"""
