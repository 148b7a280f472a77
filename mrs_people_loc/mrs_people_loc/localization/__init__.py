"""Where the robots are: dead reckoning, walls and people as observations, one estimate of the team.

Every robot runs the same estimator (`Localizer`) on its own odometry and on what the others share;
there is no leader. On a robot, a node calls `robot_localization` only: it places the robot's poses
in the map, finds `walls` in what the robot senses, and gives these and the odometry (`odometry`) to
the `localizer`. That takes what the others measured, too (`shared`), keeps what there is no
odometry for yet (`mailbox`), and lets the `filter` apply all of it in the order of time. In the
planner, `people` measures where robots are to each other.
"""
