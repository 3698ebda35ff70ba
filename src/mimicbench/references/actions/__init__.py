"""What people do when they have arrived: sit down, lie down, reach, grasp."""
