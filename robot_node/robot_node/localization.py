"""Localization of a robot: measurements and what its team tells in, what it tells its team out."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import RelativePoses
from mrs_people_msgs.msg import TeamPose as TeamPoseMessage
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mrs_people_loc import messages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import PeopleLocError, PoseError
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.localization import (
    LocalizationHealth,
    RefusalWatch,
    of_localization,
    own_sources,
)
from mrs_people_loc.localization.anchor import Anchor
from mrs_people_loc.localization.localizer import LocalizationState
from mrs_people_loc.localization.robot_localization import (
    RobotLocalization,
    localizes,
    may_localize,
)
from mrs_people_loc.localization.shared import TeamPose
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.managed_node import ManagedNode
from mrs_ros.markers import wall_markers
from mrs_ros.qos import POSES, TEAM
from robot_node.range_topics import RangeTopics
from robot_node.wall_topics import WallTopics


class LocalizationTopics:
    """The robot's localization with its topics.

    Its team are the robots whose namespaces have the same parent, where the topics of the team are.
    A robot without a namespace has none.

    Args:
        node: The robot's node.
        ranges: Its range sensors.
        localization: Takes what comes.
    """

    def __init__(
        self, node: ManagedNode, ranges: RangeTopics, localization: RobotLocalization
    ) -> None:
        self._node = node
        self._config: RobotConfig = node.config
        self._own = localization
        self._parent, _, self._robot = str(node.get_namespace()).rstrip("/").rpartition("/")
        self._state: LocalizationState | None = None
        self._refusals = RefusalWatch()
        self._walls = WallTopics(node, ranges, localization)
        self._listens = False
        self._told: Any = None
        self._drawn: Any = None
        node.serve(Trigger, "~/keep_wheels", self._keep_wheels)
        self._anchor = Anchor(self._robot)
        if self._robot:
            self._told = node.offer(TeamPoseMessage, f"{self._parent}/team_poses", TEAM)
        if self._robot and may_localize(self._config):
            self._drawn = node.offer(MarkerArray, f"{self._parent}/walls", 2)

    def start(self) -> None:
        """Subscribes, where it is known already that this is needed."""
        self._listens = False
        if localizes(self._config, self._config.pose.map_frame):
            self._listen()

    def reset(self) -> None:
        """Forgets where the robot is: the time was set back, or its start was changed."""
        self._own.reset()
        self._state = None
        self._refusals = RefusalWatch()

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters."""
        old, self._config = self._config, config
        self._own.configure(config)
        if old.pose.map_from_odom != config.pose.map_from_odom:
            self.reset()

    def tell_team(self) -> None:
        """Publishes what the team is to hear after an odometry; subscribes after the first one."""
        if not self._listens:
            self._listen()
        if self._told is not None:
            self._tell(self._own.share())

    def tell_anchor(self, pose: Pose) -> None:
        """Publishes what the team is to hear of a pose in the map that is not estimated here."""
        if self._told is not None:
            self._tell(self._anchor.tell(pose, self._config.localization.share_rate))

    def _tell(self, told: TeamPose | None) -> None:
        if told is not None:
            self._told.publish(convert.team_pose(told, self._config.pose.map_frame))

    def _listen(self) -> None:
        """Subscribes to absolute poses and to the team."""
        self._listens, node = True, self._node
        self._walls.start(self._parent)
        if self._config.pose.source != "pose_in":
            node.listen(
                PoseWithCovarianceStamped, "pose_in", self._on_absolute, POSES, any_number=True
            )
        if self._robot:
            for kind, name, callback in (
                (TeamPoseMessage, "team_poses", self._on_team_pose),
                (RelativePoses, "relative_poses", self._on_relative_poses),
            ):
                node.listen(kind, f"{self._parent}/{name}", callback, TEAM, any_number=True)

    def _on_absolute(self, message: PoseWithCovarianceStamped) -> None:
        wanted = self._config.pose.map_frame
        if message.header.frame_id.lstrip("/") != wanted:
            raise PoseError(f"frame_id is {message.header.frame_id!r}; wanted: {wanted!r}")
        self._own.take_absolute(messages.read_pose(message))

    def _on_team_pose(self, message: TeamPoseMessage) -> None:
        if message.robot != self._robot:
            told = messages.read_team_pose(message, self._config.pose.map_frame)
            self._own.take_teammate(told)

    def _on_relative_poses(self, message: RelativePoses) -> None:
        for relative in messages.read_relative_poses(message):
            self._own.take_relative(relative)

    def _keep_wheels(self, _: Any, response: Any) -> Any:
        """Writes the estimated errors of the wheels into the parameters, for the next start."""
        try:
            kept = self._own.wheels_to_keep()
            self._node.keep(kept)
        except PeopleLocError as err:
            response.success, response.message = False, str(err)
        else:
            response.success = True
            values = " and ".join(f"{name} is {list(value)}" for name, value in kept.items())
            response.message = f"{values}, from the next start on"
        return response

    # ---- what is told of it ----

    def observe(self) -> None:
        """Updates what `findings` reports; publishes the walls, for display, if anybody asks."""
        if not self._own.has_begun:
            return
        state = self._state = self._own.state
        now_ns, frame = self._now_ns(), self._config.pose.map_frame
        self._refusals.update(own_sources(self._robot, state), now_ns)
        if self._drawn is not None and self._drawn.get_subscription_count():
            self._drawn.publish(wall_markers(now_ns, frame, self._robot, state.walls))

    def findings(self) -> list[Finding]:
        """How it went when it was observed last; nothing where it does not run."""
        if self._state is None:
            return []
        now_ns = self._now_ns()
        health = LocalizationHealth(
            robot=self._robot,
            state=self._state,
            began_ns=self._own.began_ns,
            now_ns=now_ns,
            refused=self._refusals.refused(now_ns),
            dead_sonars=self._walls.sonars.dead(),
        )
        return [of_localization(health)]

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
