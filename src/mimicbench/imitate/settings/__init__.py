"""What can be set of demonstrations and learners. Nothing in here imports torch, so that help comes at once."""
