"""Robots as data: links, joints, limits, gains, keypoints, shapes."""
