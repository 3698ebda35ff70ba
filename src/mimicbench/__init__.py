"""Humanoid-scene interaction learned by mimicking humans: benchmark and toolkit."""

__version__ = "0.1.0"
