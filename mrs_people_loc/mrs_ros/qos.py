"""Quality of service of what crosses a team's network; docs/network.md has the reasons."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Images, their calibration, and scans: best effort, and only the newest is kept. What waits while
#: a frame is worked on is replaced by what is newer.
STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
#: Poses come up to some hundred times a second, and none should be lost while a frame or an
#: interval is worked on.
POSES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
#: What robots tell each other about where they are, up to 100 times a second. What was measured
#: comes several times, and dead reckoning is cumulative: what is lost costs nothing.
TEAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=20,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
#: As map_server publishes: the last map, also for subscribers that come later.
MAP = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
