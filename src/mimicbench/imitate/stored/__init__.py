"""Demonstrations as files."""
