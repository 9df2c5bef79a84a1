"""Pictures of robots and of what happened: a renderer, plots, films."""
