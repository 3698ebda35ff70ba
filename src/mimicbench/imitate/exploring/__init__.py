"""Trying a task without a reference: the episodes of learners that learn from objects alone."""
