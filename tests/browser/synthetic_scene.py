"""A made-up scene for the page: ten people in two groups, four robots, a tour; messages by time."""

from __future__ import annotations

import base64
import math
from io import BytesIO

import numpy as np
from PIL import Image as Picture

from mrs_tools.view import protocol

T0 = 100.0
BAG = protocol.Span(start=T0, end=T0 + 60.0)
ROBOTS = ("robot_a", "robot_b", "robot_c", "robot_d")
#: Offsets from the centre of the first group; the last one of them falls behind.
_FIRST = ((0.9, 0.5), (0.8, -0.6), (-0.1, 0.9), (-0.2, -0.2), (-1.0, 0.4), (-3.6, -0.9))
_SECOND = ((0.5, 0.3), (-0.4, 0.5), (0.1, -0.6))


def hello(mode: str = "live", *, control: bool = False) -> protocol.Hello:
    return protocol.Hello(
        type="hello",
        version=protocol.VERSION,
        mode="bag" if mode == "bag" else "live",
        title="walking_group" if mode == "bag" else "domain 0",
        control=control,
        bag=BAG if mode == "bag" else None,
        tours=["museum"] if control else [],
    )


def _person(
    number: int, x: float, y: float, group: int | None, speed: tuple[float, float]
) -> protocol.Person:
    return protocol.Person(
        id=number,
        x=round(x, 3),
        y=round(y, 3),
        vx=round(speed[0], 3),
        vy=round(speed[1], 3),
        cov=[0.012 + 0.002 * number, 0.004, 0.01],
        height=1.55 + 0.04 * number,
        age=20.0 + number,
        seen_s=0.0,
        predicted=False,
        seen_at=None,
        group=group,
        straggler=False,
        straggling_s=None,
    )


def people(t: float) -> list[protocol.Person]:
    ahead = 3.0 * math.sin(0.25 * (t - T0))
    speed = (0.75 * math.cos(0.25 * (t - T0)), 0.0)
    found = [
        _person(number, 8 + ahead + x, 3 + y, 1, speed)
        for number, (x, y) in enumerate(_FIRST, start=1)
    ]
    found += [
        _person(number, 15 + x, 6.2 + y, 2, (0.0, 0.1))
        for number, (x, y) in enumerate(_SECOND, start=7)
    ]
    found.append(_person(12, 3.5, 6.5, None, (0.5, -0.4)))
    found[3]["predicted"], found[3]["seen_s"], found[3]["seen_at"] = True, 0.8, [2.1, 3.4]
    found[5]["straggler"], found[5]["straggling_s"] = True, round(12 + t - T0, 1)
    return found


def robots(t: float) -> list[protocol.Robot]:
    ahead = 3.0 * math.sin(0.25 * (t - T0))
    poses = ((11.5 + ahead, 3.0, math.pi), (4.5 + ahead, 1.2, 0.2), (8.0, 7.0, -1.4), (18, 3, 2.6))
    return [
        protocol.Robot(
            name=name,
            x=round(x, 3),
            y=y,
            yaw=round(yaw, 3),
            cov=[0.004, 0.001, 0.006],
            yaw_sigma=0.02,
            reach=5.0,
            view=1.2,
            view_yaw=0.0,
            age=0.1,
            ok=name != "robot_d",
            note="no images for 4 s" if name == "robot_d" else "",
        )
        for name, (x, y, yaw) in zip(ROBOTS, poses, strict=True)
    ]


def groups(found: list[protocol.Person]) -> list[protocol.Group]:
    def group(number: int) -> protocol.Group:
        members = [person for person in found if person["group"] == number]
        there = [person for person in members if not person["straggler"]]
        return protocol.Group(
            id=number,
            x=sum(person["x"] for person in there) / len(there),
            y=sum(person["y"] for person in there) / len(there),
            members=[person["id"] for person in members],
            stragglers=[person["id"] for person in members if person["straggler"]],
        )

    return [group(1), group(2)]


def tour(t: float) -> protocol.Tour:
    ahead = 3.0 * math.sin(0.25 * (t - T0))
    return protocol.Tour(
        name="museum",
        state="waiting",
        leader="robot_a",
        progress=0.42,
        way=10.5,
        length=25.0,
        stop="blue room",
        posts=[
            protocol.Post(robot="robot_a", x=11.9 + ahead, y=3.2, yaw=math.pi, role="leader"),
            protocol.Post(robot="robot_b", x=4.2 + ahead, y=1.6, yaw=0.2, role="rear"),
        ],
        message="person 6 is behind",
        age=0.2,
        lost=[],
    )


def state(t: float, *, with_tour: bool = False) -> protocol.State:
    found = people(t)
    return protocol.State(
        type="state",
        t=t,
        age=0.1,
        people=found,
        groups=groups(found),
        robots=robots(t),
        tour=tour(t) if with_tour else None,
    )


def walls() -> protocol.Map:
    """A room of 20 m x 8.5 m as walls, with a shelf in the grid."""
    cells = np.full((85, 200), 254, np.uint8)
    cells[4:16, 100:124] = 0
    cells[60:, 180:] = 205
    png = BytesIO()
    Picture.fromarray(cells).save(png, "PNG")
    grid = protocol.Grid(
        width=200,
        height=85,
        resolution=0.1,
        x=0.0,
        y=0.0,
        yaw=0.0,
        png=base64.b64encode(png.getvalue()).decode(),
    )
    sides = [[0.0, 0, 20, 0], [20.0, 0, 20, 8.5], [20.0, 8.5, 6, 8.5], [4.0, 8.5, 0, 8.5]]
    return protocol.Map(type="map", walls=[*sides, [0.0, 8.5, 0, 0]], grid=grid)


def image(robot: str, t: float) -> protocol.Image:
    rows, columns = np.mgrid[0:90, 0:120]
    return protocol.Image(
        type="image",
        robot=robot,
        t=t,
        age=0.1,
        image=_jpeg(np.stack([rows, columns, rows + columns], axis=2)),
        disparity=_jpeg(np.stack([columns, rows, 120 - columns], axis=2)),
        note="",
    )


def _jpeg(pixels: np.ndarray) -> str:
    data = BytesIO()
    Picture.fromarray(pixels.astype(np.uint8)).save(data, "JPEG")
    return base64.b64encode(data.getvalue()).decode()


def cells(t: float) -> protocol.Cells:
    places = {name: list[float]() for name in ROBOTS}
    for person in people(t):
        for step in range(8):
            places["robot_a"] += [person["x"] + 0.15, person["y"] - 0.2 + 0.05 * step]
    return protocol.Cells(type="cells", t=t, robots=places)


def health() -> protocol.Health:
    silent = protocol.Finding(
        level="error",
        subject="robot_d",
        text="No images from the left camera for 4 s.",
        advice="Check that the camera's driver runs: ros2 topic hz /robot_d/left/image_raw",
        follows=["robot_d: no scans"],
    )
    late = protocol.Finding(
        level="warning",
        subject="robot_b",
        text="Its clock is 80 ms ahead of the planner's.",
        advice="Synchronize the clocks with chrony (docs/network.md).",
        follows=[],
    )
    return protocol.Health(type="health", level="error", findings=[silent, late])


def everything(t: float = T0) -> list[protocol.Message]:
    """A message of each kind that a live team has."""
    return [walls(), state(t, with_tour=True), health(), event("Person 12 is new.", t)]


def event(text: str, t: float = T0) -> protocol.Event:
    return protocol.Event(type="event", t=t, text=text)
