"""Where the robots are: dead reckoning, walls and people as observations, one estimate of the team.

Every robot runs the same estimator (`Localizer`) on its own odometry and on what the others share;
there is no leader. On a robot, a node calls `robot_localization`: it finds `walls` in what the
robot senses, and gives them and the odometry (`odometry`) to the `localizer`. That takes what the
others tell, too (`shared`), and lets the `filter` apply all of it in the order of time. In the
planner, `people` measures where robots are to each other.
"""
