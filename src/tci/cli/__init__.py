"""The command line, `tci`.

`main` registers the commands. Each one is declared in the file of its name; options that several commands
share are in `options`. Heavy modules are imported inside functions, so that --help and completion are fast.
The other files carry out the commands of `tci skin` and print the output of `run` and `check`.
"""
