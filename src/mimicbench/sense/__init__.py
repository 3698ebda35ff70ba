"""What the robot senses: proprioception, ego cameras, elevation maps."""
