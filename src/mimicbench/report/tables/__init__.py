"""Tables of episodes, each one file, and the registry."""
