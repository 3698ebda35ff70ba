"""Objects made of anybody's meshes: reading, mending, standing them up, splitting, and finding what they are for."""
