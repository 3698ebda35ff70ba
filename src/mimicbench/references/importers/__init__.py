"""Recorded motion, one file a format."""
