"""Scenes and batched physics: one interface, whatever computes it."""
