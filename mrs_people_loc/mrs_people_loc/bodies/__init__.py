"""The default method: upright bodies, sought in each view and joined on the common map.

search -> patches -> votes -> model -> finder   (on the robot)
joining                                          (in the planner)
"""
