"""`tci` on the command line.

`main` gathers the commands, each declared once in the file of its name with the `options` that several share.
Such a file imports what is heavy inside its functions, so that --help and completion stay quick.
The other files hold the work of the commands of `skin`, and what `run` and `check` print.
"""
