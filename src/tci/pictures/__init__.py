"""Pictures of robots and of what happened to them.

The renderer casts rays on the processor, so it needs no OpenGL. Plots and films are made from runs and
recordings.
"""
