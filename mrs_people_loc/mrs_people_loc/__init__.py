"""The method: from stereo images to the people of a group, on one common map. No ROS here.

The data flows through the modules in this order:

| step | module | equations |
|---|---|---|
| images: read, rectified, paired | `messages`, `camera`, `images` | |
| disparity | `disparity` | |
| scan of one robot: cloud, zones, noise windows, cells | `cloud`, `filters`, `scan` | 1-5 |
| `RobotPipeline.step(images) -> Scan` | `robot` | |
| interval: clocks, poses over time, which scans | `clocks`, `poses`, `interval` | |
| map: common frame | `fusion` | 6 |
| robots, walls and furniture are no people | `masking` | |
| bodies of several robots that are one | `joining`, `neighbours` | |
| clusters, and those of several people split | `clustering`, `splitting` | 8-10 |
| people: human-sized clusters, positions, group | `people` | |
| `Planner.step(scans, poses, time) -> People` | `planner` | |

Beside the flow: `floor` and `sight` watch a head, `agreement` the robots' poses.
"""

__version__ = "0.1.0"
