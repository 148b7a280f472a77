"""Tours as they are asked for: goals of the action `guide_tour`, paths on `tour_path`."""

from __future__ import annotations

from typing import Any

from mrs_people_loc.errors import TourError
from mrs_people_loc.guiding.tour import Tour, tour_from


def tour_of_goal(goal: Any, map_frame: str) -> Tour:
    """Reads mrs_people_msgs/GuideTour_Goal.

    Args:
        goal: The goal.
        map_frame: The frame that its path must be in: the common one.

    Raises:
        TourError: It cannot be guided.
    """
    stops = [
        (stop.name, (stop.position.x, stop.position.y), stop.wait.sec + 1e-9 * stop.wait.nanosec)
        for stop in goal.stops
    ]
    speed = float(goal.speed) or None
    points = _points(goal.path, map_frame)
    return tour_from(points, stops, name=goal.name or "tour", speed=speed, frame=map_frame)


def tour_of_path(path: Any, map_frame: str) -> Tour:
    """Reads nav_msgs/Path as a tour without stops.

    Raises:
        TourError: It cannot be guided.
    """
    return tour_from(_points(path, map_frame), name="tour_path", frame=map_frame)


def _points(path: Any, map_frame: str) -> list[tuple[float, float]]:
    """The places of a path [m]; a pose without a frame is in the path's."""
    frames = {path.header.frame_id, *(pose.header.frame_id or path.header.frame_id
                                      for pose in path.poses)}  # fmt: skip
    if frames != {map_frame}:
        wrong = ", ".join(sorted(repr(frame) for frame in frames - {map_frame}))
        raise TourError(f"the path's frame_id is {wrong}; wanted: {map_frame!r}")
    return [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
