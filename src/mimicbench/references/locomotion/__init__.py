"""Walking: footsteps, feet that never skate, and plans from the midst of any motion."""
