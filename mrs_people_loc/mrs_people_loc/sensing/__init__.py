"""Sensing: from images to a disparity image, and to points in the robot's floor frame."""
