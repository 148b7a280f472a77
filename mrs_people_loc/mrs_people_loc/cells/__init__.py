"""The paper's method: cells of the ground plane, and clusters of them that have human size.

On the robot: `filters` (zones, noise windows, cells; eqs. 1-5) -> `scanner` (the scan).
In the planner: `clustering` (eqs. 8-10) -> `splitting` (not in the paper) -> `human` (size,
position) -> `detector` (people).
"""
