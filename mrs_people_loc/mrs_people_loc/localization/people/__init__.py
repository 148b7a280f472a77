"""People as landmarks: where robots are to each other, by the people whom both see.

The planner measures it: `seen_people` (whom each robot sees by itself) -> `alignment` (who of them
are the same, and the move and turn between the robots) -> `relative_poses` (window by window).
"""
