"""Pictures of robots and of their runs.

The renderer casts rays on the processor, so it needs no OpenGL. Plots and films are made from runs and
recordings.
"""
