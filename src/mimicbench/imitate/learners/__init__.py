"""Learners, one file each: what they are configured by, their networks, how they learn, and the policies they give."""
