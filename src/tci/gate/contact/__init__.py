"""Contact as a cause of its own: how the gate notices that a part met somebody, and lets go."""
