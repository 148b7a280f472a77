"""The method: from stereo images to people and their groups on one common map. No ROS here.

There are two methods: the default one looks for bodies in each view, the paper's for clusters of
cells of human size (`bodies.search` in the configuration). A planner takes scans of both.

On each robot, `robot.RobotPipeline.step(images) -> Scan` (`head.Head` pairs the images):

| step | default | paper | equations |
|---|---|---|---|
| images: decoded, rectified, paired | `messages`, `sensing.camera`, `sensing.images` | likewise | |
| disparity | `sensing.disparity` | likewise | |
| points over the floor | for display only | `sensing.cloud` | |
| candidates | `bodies.search`, `.patches`, `.votes` | zones, noise: `cells.filters` | 1-3 |
| score and axis | `bodies.model`, `.finder` | | |
| cells | `bodies.finder`, `.scanner` | `cells.filters`, `.scanner` | 4-5 |

In the planner, `planner.Planner.step(scans, poses, time) -> People`:

| step | default | paper | equations |
|---|---|---|---|
| interval: clocks, poses, scans | `clocks`, `team.poses`, `team.intervals` | likewise | |
| one map | `team.fusion` | likewise | 6 |
| robots, walls and furniture masked | `team.masking` | not in the paper | |
| bodies of several robots merged | `bodies.joining` | | |
| clusters | | `cells.clustering`; `.splitting` is not in the paper | 8-10 |
| people | `bodies.detector` | `cells.human`, `cells.detector` | |
| tracks, groups | `following.tracks`, `.groups` | one group: `people.gather` | |

What flows is defined in `scan`, `clusters` and `people`. `health` watches a head, the floor it sees
and the robots' poses. `config` holds all parameters, `anthropometry` sizes of people and
`precision` what matching errs by.
"""

__version__ = "0.1.0"
