"""The default method: upright bodies, found in each view and joined on the common map.

On the robot: `search` (candidates) -> `patches` (what is around them) -> `votes` (one disparity
each) -> `model` (log-odds of a person, axis) -> `network`, `appearance` (what it looks
like) -> `finder` (bodies, cells) -> `scanner` (the scan).
In the planner: `joining` (bodies of several robots that are one) -> `places` (what has stood there
before) -> `detector` (people).
"""
