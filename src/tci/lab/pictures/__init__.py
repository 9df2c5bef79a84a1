"""Pictures of robots and of runs.

The renderer casts rays on the processor, so the renderer does not need OpenGL. Plots and films are made from
runs and recordings.
"""
