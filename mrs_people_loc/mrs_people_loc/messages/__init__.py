"""Reads ROS messages into the core's types, and checks them.

Only the messages' attributes are used, which are the same in rclpy's and in rosbags' classes, so
nodes and offline tools read, and refuse, the same. Every error names the field, what was got and
what is wanted; the caller adds the topic.
"""

from mrs_people_loc.messages.grids import read_occupancy_grid
from mrs_people_loc.messages.guiding import read_people, read_tour_goal, read_tour_path
from mrs_people_loc.messages.images import ENCODINGS, read_camera_info, read_image
from mrs_people_loc.messages.localization import read_relative_poses, read_team_pose
from mrs_people_loc.messages.poses import read_people_scans, read_pose, read_transform
from mrs_people_loc.messages.ranges import read_laser_scan, read_range
from mrs_people_loc.messages.scans import read_scan
from mrs_people_loc.messages.stamps import read_stamp, stamp_ns_of

__all__ = [
    "ENCODINGS",
    "read_camera_info",
    "read_image",
    "read_laser_scan",
    "read_occupancy_grid",
    "read_people",
    "read_people_scans",
    "read_pose",
    "read_range",
    "read_relative_poses",
    "read_scan",
    "read_stamp",
    "read_team_pose",
    "read_tour_goal",
    "read_tour_path",
    "read_transform",
    "stamp_ns_of",
]
