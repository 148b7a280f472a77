"""The filter of a team: one estimate of the poses of its robots and of the walls that they see.

`team_filter` puts observations in the order of their stamps, and applies one after the other to a
`team_state`: `observations` (predictions and Jacobians), `kalman` (the update),
`wall_landmarks` (which wall is seen), `team_frame` (how sure poses are relative to the team).
"""
