"""What brings a link and a capability together: the loop, and the registry of links by name."""
