"""The command line, `tci`.

The module `main` registers the commands, each command has a module of the same name, and `options` declares
the options that several commands share. Large modules are imported inside the functions of the commands, so
that --help and completion do not load these modules and are fast.
"""
