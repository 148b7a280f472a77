"""The robot_node: ROS around the method."""
