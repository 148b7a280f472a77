"""The planner_node: ROS around the method."""
