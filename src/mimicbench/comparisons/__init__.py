"""Comparisons, one file each: recipes that differ in one thing, learned and judged side by side."""
