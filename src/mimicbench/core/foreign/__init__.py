"""Reading files that others made, whom nobody vouches for."""
