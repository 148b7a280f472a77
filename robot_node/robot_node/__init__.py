"""One robot on ROS: images in, `points` and `pose` out; a disparity image while it is asked for."""
