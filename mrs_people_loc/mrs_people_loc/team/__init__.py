"""The team: clocks, poses and intervals of several robots, and their cells on one map."""
