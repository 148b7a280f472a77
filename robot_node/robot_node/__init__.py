"""One robot on ROS: images in, `points` and `pose` out. Images never leave the robot."""
