"""Where the robots are: dead reckoning, walls and people as observations, one estimate of the team.

Every robot runs the same estimator (`Localizer`) on its own odometry and on what the others share;
there is no leader.
"""
