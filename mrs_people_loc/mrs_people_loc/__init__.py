"""The method: from stereo images to people and their groups on one common map. No ROS here.

As a library: `import mrs_people_loc as mrs`, see `docs/python.md`. The names below are public;
their modules are imported when they are first asked for.

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

Where the robots are, for those whose odometry is in a frame of its own. A robot's node calls
`RobotLocalization`; every robot of the team estimates the poses of all:

| step | module |
|---|---|
| walls in disparities, laser scans, sonars; known walls | `localization.walls` |
| dead reckoning, with covariance | `localization.odometry` |
| poses of the team and walls: an invariant Kalman filter | `localization.filter`, `.localizer` |
| relative poses by people whom two robots see (planner) | `localization.people` |

Guiding, on one node for the team, which calls `TourControl`:

| step | module |
|---|---|
| the way, its stops, the tour's file | `guiding.way`, `guiding.tour` |
| who is guided and waited for, which robot leads, how fast | `guiding.guide` |
| posts from which the team sees most of the group | `guiding.formation` |
| velocities that keep distances to people, robots and walls | `guiding.drive`, `.free_space` |

What flows is defined in `scan`, `clusters` and `people`. `health` watches a head, the floor it
sees and the robots' poses, and turns the state of nodes into findings. `config` holds all
parameters, `anthropometry` sizes of people and `precision` errors of matching.
"""

from typing import TYPE_CHECKING

from mrs_people_loc.exports import public_names

__version__ = "0.1.0"

if TYPE_CHECKING:
    from mrs_people_loc.config import GuideConfig as GuideConfig
    from mrs_people_loc.config import Mounting as Mounting
    from mrs_people_loc.config import PlannerConfig as PlannerConfig
    from mrs_people_loc.config import RobotConfig as RobotConfig
    from mrs_people_loc.config import Team as Team
    from mrs_people_loc.config import load_team as load_team
    from mrs_people_loc.errors import PeopleLocError as PeopleLocError
    from mrs_people_loc.guiding.free_space import FreeSpace as FreeSpace
    from mrs_people_loc.guiding.guidance import Guidance as Guidance
    from mrs_people_loc.guiding.guidance import Post as Post
    from mrs_people_loc.guiding.guide import Guide as Guide
    from mrs_people_loc.guiding.tour import Tour as Tour
    from mrs_people_loc.guiding.tour import read_tour as read_tour
    from mrs_people_loc.guiding.tour import tour_from as tour_from
    from mrs_people_loc.head import Head as Head
    from mrs_people_loc.head import View as View
    from mrs_people_loc.localization.localizer import LocalizationState as LocalizationState
    from mrs_people_loc.localization.robot_localization import (
        RobotLocalization as RobotLocalization,
    )
    from mrs_people_loc.localization.shared import TeamPose as TeamPose
    from mrs_people_loc.localization.walls.ranges import LaserScan as LaserScan
    from mrs_people_loc.localization.walls.ranges import SonarRange as SonarRange
    from mrs_people_loc.people import Group as Group
    from mrs_people_loc.people import Person as Person
    from mrs_people_loc.planner import People as People
    from mrs_people_loc.planner import Planner as Planner
    from mrs_people_loc.robot import RobotPipeline as RobotPipeline
    from mrs_people_loc.scan import Cells as Cells
    from mrs_people_loc.scan import Scan as Scan
    from mrs_people_loc.sensing.camera import CameraModel as CameraModel
    from mrs_people_loc.sensing.camera import StereoCamera as StereoCamera
    from mrs_people_loc.sensing.images import ImagePreparer as ImagePreparer
    from mrs_people_loc.sensing.images import StereoImages as StereoImages
    from mrs_people_loc.team.intervals import IntervalCollector as IntervalCollector
    from mrs_people_loc.team.masking import OccupancyGrid as OccupancyGrid
    from mrs_people_loc.team.poses import Pose as Pose
else:
    __all__, __getattr__, __dir__ = public_names(
        __name__,
        {
            "config": "GuideConfig Mounting PlannerConfig RobotConfig Team load_team",
            "errors": "PeopleLocError",
            "guiding.free_space": "FreeSpace",
            "guiding.guidance": "Guidance Post",
            "guiding.guide": "Guide",
            "guiding.tour": "Tour read_tour tour_from",
            "head": "Head View",
            "localization.localizer": "LocalizationState",
            "localization.robot_localization": "RobotLocalization",
            "localization.shared": "TeamPose",
            "localization.walls.ranges": "LaserScan SonarRange",
            "people": "Group Person",
            "planner": "People Planner",
            "robot": "RobotPipeline",
            "scan": "Cells Scan",
            "sensing.camera": "CameraModel StereoCamera",
            "sensing.images": "ImagePreparer StereoImages",
            "team.intervals": "IntervalCollector",
            "team.masking": "OccupancyGrid",
            "team.poses": "Pose",
        },
    )
