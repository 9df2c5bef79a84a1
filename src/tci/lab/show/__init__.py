"""The second demo: people touch robots, and each robot answers in its own way (`tci demo --show touch`)."""
