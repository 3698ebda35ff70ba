"""The ways to retarget, one file each."""
