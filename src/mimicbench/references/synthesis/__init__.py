"""Synthetic clips, one file a task, and planning from anywhere."""
