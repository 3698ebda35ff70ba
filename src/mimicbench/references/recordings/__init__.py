"""Clips of the tasks cut out of recordings, and objects fitted to the people in them."""
