"""Human clips: skeletons, motion synthesis per task, and importers of recorded motion. Knows no robot."""
