"""The method: from stereo images to the people of a group, on one common map. No ROS here.

The data flows through the modules in this order:

| step | module | equations |
|---|---|---|
| images: read, rectified, paired | `messages`, `camera`, `images` | |
| disparity | `disparity` | |
| scan of one robot: cloud, zones, noise windows, cells | `cloud`, `filters`, `scan` | 1-5 |
| `RobotPipeline.step(images) -> Scan` | `robot` | |
| map: poses over time, intervals, common frame | `poses`, `interval`, `fusion` | 6 |
| clusters | `clustering` | 8-10 |
| people: human-sized clusters, positions, group | `people` | |
| `Planner.step(scans, poses, time) -> People` | `planner` | |
"""

__version__ = "0.1.0"
