"""What can be wrong with a clip, and what a set of clips is."""
