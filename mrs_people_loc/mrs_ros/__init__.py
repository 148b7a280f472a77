"""ROS glue that the nodes share."""
