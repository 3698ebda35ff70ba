"""Furniture and household objects: parametric families, affordances, splits, and own objects brought in."""
