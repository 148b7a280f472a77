"""The planner on ROS: all robots' `points` and `pose` in, people out."""
