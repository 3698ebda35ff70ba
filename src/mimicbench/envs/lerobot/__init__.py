"""The tasks for LeRobot, which finds its environment type `mimicbench` in this package."""
