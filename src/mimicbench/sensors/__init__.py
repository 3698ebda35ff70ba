"""What a robot senses of itself and of the scene. Sensors see shapes, never labels."""
