"""Learners from demonstrations: one file each, what they see, and how they are trained."""
