"""What every stage shares: rotations, motions, files, seeds, errors. Knows no robot and no task."""
