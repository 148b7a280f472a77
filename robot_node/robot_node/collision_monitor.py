"""The collision monitor of a robot: `cmd_vel_guide` in, `cmd_vel` out."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool

from mrs_people_loc.arrays import Float32
from mrs_people_loc.clocks import Standstill
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.guiding.collision_monitor import Action, CollisionMonitor, Verdict
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.obstacles import HeadObstacles, SonarObstacles, obstacles_of_laser
from mrs_people_loc.health.findings import Finding
from mrs_people_loc.health.robot import of_monitor
from mrs_people_loc.localization.walls.finder import Mounting
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import STREAM
from robot_node.range_topics import RangeTopics

#: Velocities are looked at again after this time without a new one [s].
_PERIOD_S = 0.05
#: Without a command for so long the robot is told to stand [s], ...
_SILENT_S = 0.2
#: ... so often; then others may drive.
_ZEROS = 10
#: What was sent last is waited for so long before the publisher is destroyed [s].
_ACKNOWLEDGED_S = 0.2
#: Only the newest velocity counts.
_COMMANDS = QoSProfile(depth=1)
#: Topics of std_msgs/Bool that stop the robot while they are true.
_STOPS = ("bumper", "base_fault")
#: Stamps that are farther ahead of the clock than this are refused [s].
_AHEAD_S = 0.1
#: `/clock` has ended once it stands still for so long [s].
_FROZEN_S = 1.0
#: Obstacles have this height over the floor on `obstacles` [m].
_HEIGHT = 0.3


class MonitorTopics:
    """The monitor with its topics.

    Args:
        node: The robot's node.
        base_frame: Its base_link.
        ranges: Its range sensors.
    """

    def __init__(self, node: ManagedNode, base_frame: str, ranges: RangeTopics) -> None:
        self._node, self._base_frame, self._ranges = node, base_frame, ranges
        config: RobotConfig = node.config
        self._enabled, self._disparity = config.collision_monitor.enabled, config.disparity
        self._type: Any = TwistStamped if config.collision_monitor.stamped else Twist
        self._core = CollisionMonitor(config.collision_monitor)
        self._head: HeadObstacles | None = None
        self._sonars: dict[str, SonarObstacles] = {}
        self._out: Any = None
        self._timer: Any = None
        self._wanted: Velocity = (0.0, 0.0)
        self._wanted_s = self._stepped_s = 0.0
        self._zeros = 0
        self._verdict: Verdict | None = None
        self._clock = Standstill()
        self._obstacles = node.offer(PointCloud2, "obstacles", STREAM)
        # Before others, which may refuse a scan.
        ranges.on_laser.insert(0, self._take_laser)
        ranges.on_range.insert(0, self._take_range)

    def start(self) -> None:
        """Subscribes."""
        node = self._node
        if not self._enabled:
            return
        self._ranges.start()
        walls = node.config.walls
        laser = ("scan",) if walls.laser else ()
        self._core.expected = (*laser, *map(self._name_of, walls.sonars))
        node.listen(self._type, "cmd_vel_guide", self._on_command, _COMMANDS, any_number=True)
        for name in _STOPS:
            node.listen(Bool, name, partial(self._on_stop, name), _COMMANDS, any_number=True)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD_S, self._tick, clock=steady)

    def stop(self) -> None:
        """Lets the robot stand, if it was driven here."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
        if self.reset():
            self._out.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED_S))
        for name in _STOPS:
            self._core.take_contact(name, pressed=False)

    def reset(self) -> bool:
        """Forgets what was seen and commanded; whether a driven robot was told to stand."""
        is_driven = self._out is not None and (self._zeros > 0 or self._verdict is not None)
        if is_driven:
            self._publish((0.0, 0.0))
        self._core.reset()
        self._sonars.clear()
        self._verdict, self._zeros = None, 0
        return is_driven

    def changed(self, config: RobotConfig) -> None:
        """Takes new parameters."""
        self._core.config, self._disparity = config.collision_monitor, config.disparity
        self._head = None

    # ---- inputs ----

    def take_view(self, disparity: Float32, stamp_ns: int, camera: StereoCamera) -> None:
        """Takes a view of the head."""
        asked = self._obstacles.get_subscription_count()
        if not self._enabled and not asked:
            return
        now_s = self._now_s()
        seen_s = self._seen_s("head", stamp_ns, now_s)
        if seen_s is None:
            return
        if self._head is None or self._head.camera is not camera:
            nearest = self._disparity.min_range
            self._head = HeadObstacles(camera, self._core.config, nearest=nearest)
        self._core.take_scan("head", self._head(disparity), seen_s, now_s)
        if asked:
            xy = self._core.obstacles(now_s)
            xyz = np.column_stack([xy, np.full(len(xy), _HEIGHT)])
            stamp_ns = self._node.get_clock().now().nanoseconds
            self._obstacles.publish(convert.xyz_cloud(stamp_ns, self._base_frame, xyz))

    def take_odometry(self, pose: Pose) -> None:
        """Takes where the robot is, in any frame that goes on smoothly."""
        at_s = self._now_s() - max(self._age_s(pose.stamp_ns), 0.0)
        self._core.take_odometry(pose.x, pose.y, pose.yaw, at_s)

    def _take_laser(self, scan: LaserScan, mounting: Mounting) -> None:
        now_s = self._now_s()
        seen_s = self._seen_s("scan", scan.stamp_ns, now_s)
        if seen_s is not None:
            self._core.take_scan("scan", obstacles_of_laser(scan, mounting), seen_s, now_s)

    def _take_range(self, topic: str, measured: SonarRange, mounting: Mounting) -> None:
        now_s, name = self._now_s(), self._name_of(topic)
        seen_s = self._seen_s(name, measured.stamp_ns, now_s)
        if seen_s is not None:
            scan, age_s = self._sonars.setdefault(topic, SonarObstacles())(measured, mounting)
            self._core.take_scan(name, scan, seen_s - age_s, now_s)

    def _name_of(self, topic: str) -> str:
        return topic.removeprefix(f"{self._node.get_namespace().rstrip('/')}/")

    def _now_s(self) -> float:
        """The time, by a clock that nobody sets back, or by `/clock` [s]."""
        if self._node.get_parameter("use_sim_time").value:
            return float(self._node.get_clock().now().nanoseconds / 1e9)
        return time.monotonic()

    def _seen_s(self, name: str, stamp_ns: int, now_s: float) -> float | None:
        """A stamp by that clock [s], now at the latest; None, and a fault: it is of the future."""
        age_s = self._age_s(stamp_ns)
        if age_s < -_AHEAD_S:
            self._core.refuse(name, f"has stamps {-age_s:.1f} s ahead of the clock")
            return None
        return now_s - max(age_s, 0.0)

    def _age_s(self, stamp_ns: int) -> float:
        return float(self._node.get_clock().now().nanoseconds - stamp_ns) / 1e9

    def _on_stop(self, name: str, message: Bool) -> None:
        self._core.take_contact(name, pressed=bool(message.data))
        self._tick()

    def _on_command(self, message: Any) -> None:
        twist = message if self._type is Twist else message.twist
        self._wanted, self._wanted_s = (twist.linear.x, twist.angular.z), self._now_s()
        if self._out is None:
            self._out = self._node.offer(self._type, "cmd_vel", _COMMANDS)
        self._zeros = _ZEROS
        self._step(self._wanted_s)

    # ---- outputs ----

    def _tick(self) -> None:
        """Looks again at the last command, and lets the robot stand once it is too old."""
        now_s = self._now_s()
        if not self._node.is_active or not self._zeros:
            return
        if now_s - self._wanted_s > _SILENT_S:
            self._wanted, self._zeros = (0.0, 0.0), self._zeros - 1
            self._step(now_s)
            if not self._zeros:
                self._verdict = None
        elif now_s - self._stepped_s >= 0.9 * _PERIOD_S:
            self._step(now_s)

    def _step(self, now_s: float) -> None:
        self._stepped_s = now_s
        self._verdict = self._core.step(self._wanted, now_s)
        if self._clock.lasts_s(now_s, time.monotonic()) > _FROZEN_S:
            self._verdict = Verdict(action=Action.FAILS, reason="/clock stands still")
        self._publish(self._verdict.velocity)

    def _publish(self, velocity: Velocity) -> None:
        now_ns = self._node.get_clock().now().nanoseconds
        self._out.publish(convert.velocity(self._type, velocity, now_ns, self._base_frame))

    def findings(self) -> list[Finding]:
        """What it does with the commands, if there is one."""
        return [of_monitor(self._verdict)] if self._enabled else []
