"""Guiding on ROS: people, poses, a map and a tour in; velocities or goals for the robots out."""
