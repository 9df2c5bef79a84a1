"""`tci` on the command line.

`main` gathers the commands; `run_commands` and `robot_commands` declare those that stand alone, with
the `options` that several share; every other module is what one command does.
"""
