"""The six household tasks, each one file, and the registry."""
