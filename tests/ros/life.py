"""Three robots and a planner, as processes that may be killed, fed with the recorded formation."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mrs_people_msgs.msg import People

from ros.harness import ROOT, NodeProcess, Peer, Team
from ros.planner_peer import robots_in
from ros.recording import Recording, set_stamp, stamp_of

ROBOTS = ("robot_a", "robot_b", "robot_c")


@dataclass
class Life:
    """Three robot_nodes and a planner_node that are fed and heard all the time."""

    peer: Peer
    team: Team
    recording: Recording
    planner: NodeProcess
    people: list[People]
    robots: dict[str, NodeProcess] = field(default_factory=dict)
    frame: int = 0
    due_s: float = 0.0

    def start(self, robot: str) -> None:
        """Starts a robot_node."""
        files = [ROOT / "config" / "team.yaml"]
        self.robots[robot] = self.team.start("robot_node", namespace=f"/{robot}", files=files)

    def feed(self) -> None:
        """Sends the next frame of what every robot sees, stamped now, five times a second."""
        self.peer.spin(max(0.0, self.due_s - time.monotonic()))
        self.due_s = time.monotonic() + 0.2
        self.frame += 1
        now_ns = time.time_ns()
        for robot in ROBOTS:
            odometry = self.recording.odometry[robot][0]
            set_stamp(odometry, now_ns)
            self.peer.publisher(type(odometry), f"/{robot}/odom").publish(odometry)
            views = self.recording.views[robot]
            for camera, (image, info) in views[self.frame % len(views)].items():
                for message, topic in ((info, "camera_info"), (image, "image_rect")):
                    set_stamp(message, now_ns)
                    name = f"/{robot}/{camera}/{topic}"
                    self.peer.publisher(type(message), name).publish(message)

    def until(self, condition: Callable[[], Any], what: str) -> float:
        """Feeds until a condition holds; how long that took [s]."""
        began = time.monotonic()
        while not condition():
            assert time.monotonic() - began < 60.0, f"{what}: {self.seen()}\n{self.planner.log}"
            self.feed()
        return time.monotonic() - began

    def until_seen_by(self, *robots: str) -> float:
        """Feeds until an interval from now on is of these robots."""
        now_ns = time.time_ns()

        def seen() -> bool:
            last = self.people[-1] if self.people else None
            return last is not None and stamp_of(last) >= now_ns and robots_in(last) == [*robots]

        return self.until(seen, f"an interval of {robots}")

    def seen(self) -> list[list[str]]:
        """Robots of the last intervals."""
        return [robots_in(message) for message in self.people[-5:]]


def kill(process: NodeProcess) -> None:
    process.process.send_signal(signal.SIGKILL)
    assert process.exit_code() == -signal.SIGKILL
