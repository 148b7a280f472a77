"""The scene file: what stands, walks and looks in it.

A scene is a YAML file. Every section below is a mapping whose keys, meanings and ranges are the
fields here; what is not named has its default, what is not known is an error::

    name: two_people
    seed: 7
    timing: {frames: 5, rate: 10.0}
    room: {length: 8.0, width: 7.0}
    furniture: [{kind: table, x: 2.6, y: 1.3}]
    people:
      - {x: 3.0, y: 3.5, yaw: 0.0}
      - {path: [1.0, 1.0, 5.0, 2.0], speed: 1.1}
    robots:
      robot_a: {x: 6.3, y: 3.5, yaw: 3.14, head: {pitch: 0.3, height: 1.5}}
      robot_b: {x: 1.0, y: 1.0, sonars: [{y: 0.2, yaw: 1.57}, {y: -0.2, yaw: -1.57}], laser: {}}
    head: {baseline: 0.10}        # of all robots, unless they say otherwise; so sonars and laser
    imaging: {noise: 2.0}
    odometry: {mode: exact}
    layout: {people: 4}           # ... and what `layouts.py` adds at random
    tour: {points: [[1.0, 1.0], [6.0, 1.0]]}   # where the team guides people (docs/guiding.md)
    bystanders: [{path: [6.0, 1.2, 1.0, 1.2], near: 4.0}]   # ... past somebody who comes

Positions are metres in `map`, whose origin is a corner of the room; angles are radians; a path is
a flat list x0, y0, x1, y1, ...
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mrs_people_loc.config import PlannerConfig, Section, load_yaml, suggestion
from mrs_people_loc.errors import ConfigError

_TAU = 6.2832
#: Longest scene [s]: everybody's way is kept in steps of some milliseconds.
_MAX_S = 3600
#: Longest path [m]: it is kept in steps of centimetres.
_MAX_PATH_M = 10_000


def _field(default: Any, doc: str, **limits: Any) -> Any:
    kind = limits.pop("kind", "strs") if isinstance(default, tuple) else type(default).__name__
    return dataclasses.field(default=default, metadata={"kind": kind, "doc": doc, **limits})


@dataclass(frozen=True)
class Timing(Section):
    """When images are taken."""

    frames: int = _field(5, "images per camera", low=1, high=100_000)
    rate: float = _field(10.0, "images per second [Hz]", low=0.1, high=200.0)
    start: float = _field(1.0e9, "stamp of the first frame, since 1970 [s]", low=0.0, high=4.0e9)


@dataclass(frozen=True)
class Room(Section):
    """Floor, walls and light. One corner is the origin of `map`."""

    length: float = _field(8.0, "along x [m]", low=1.0, high=200.0)
    width: float = _field(7.0, "along y [m]", low=1.0, high=200.0)
    height: float = _field(2.8, "floor to ceiling [m]", low=1.8, high=20.0)
    walls: str = _field(
        "plaster",
        "surface of the walls",
        choices=("plaster", "wallpaper", "brick", "concrete", "wood", "plain", "speckle"),
    )
    floor: str = _field(
        "carpet",
        "surface of the floor",
        choices=("carpet", "planks", "tiles", "concrete", "plain", "speckle"),
    )
    contrast: float = _field(
        1.0, "contrast of every texture; a third of it is a poor room", low=0.0, high=3.0
    )
    wall_shade: float = _field(0.6, "reflectance of the walls", low=0.05, high=0.95)
    floor_shade: float = _field(0.38, "reflectance of the floor", low=0.05, high=0.95)
    posters: int = _field(4, "posters, boards and windows on the walls", low=0, high=100)
    doors: int = _field(1, "doors in the walls", low=0, high=20)
    lamps: int = _field(2, "lamps under the ceiling", low=1, high=8)
    ambient: float = _field(
        0.45, "share of the light that comes from everywhere", low=0.0, high=1.0
    )


#: Furniture and clutter that can be placed, see `rooms.py` and, from `door` on, `interiors.py`.
FURNITURE = (
    "table", "table_on_edge", "chair", "desk", "shelf", "cabinet", "pillar", "plant", "partition",
    "bin", "boxes", "coat_stand", "sign", "sofa", "lamp", "board", "block", "wall",
    "door", "doorway", "corner", "pier", "window", "radiator", "wardrobe", "rack", "office_chair",
    "workplace", "covered_table", "curtain", "coat_on_stand", "coat_hooks", "ladder", "whiteboard",
    "water_cooler",
)  # fmt: skip


@dataclass(frozen=True)
class Furniture(Section):
    """One piece of furniture; its front looks along x before it is turned."""

    kind: str = _field("table", "what it is", choices=FURNITURE)
    x: float = _field(0.0, "its middle [m]", low=-200.0, high=200.0)
    y: float = _field(0.0, "its middle [m]", low=-200.0, high=200.0)
    z: float = _field(0.0, "what it stands on, over the floor [m]", low=0.0, high=5.0)
    yaw: float = _field(0.0, "turned to the left [rad]", low=-_TAU, high=_TAU)
    size: tuple[float, ...] = _field(
        (), "edge lengths x, y, z; empty: as such things are [m]", kind="floats", length=3
    )
    open: float = _field(
        0.0, "how far the leaf of a door or doorway stands open [rad]", low=0.0, high=2.8
    )


@dataclass(frozen=True)
class Person(Section):
    """One person. Without a path or a walk, they stand where x, y and yaw say."""

    x: float = _field(0.0, "axis of the neck, in the map [m]", low=-1000.0, high=1000.0)
    y: float = _field(0.0, "axis of the neck, in the map [m]", low=-1000.0, high=1000.0)
    yaw: float = _field(0.0, "where the person faces [rad]", low=-_TAU, high=_TAU)
    path: tuple[float, ...] = _field((), "x0, y0, x1, y1, ... to walk along [m]", kind="floats")
    speed: float = _field(1.0, "walking speed [m/s]", low=0.0, high=4.0)
    walks: bool = _field(False, "walks about on their own, from x, y")
    goal: tuple[float, ...] = _field(
        (), "where one who walks wants to go; empty: anywhere [m]", kind="floats", length=2
    )
    area: tuple[float, ...] = _field(
        (), "x, y, radius of the circle where one who walks stays; empty: the room [m]",
        kind="floats", length=3,
    )  # fmt: skip
    member: bool = _field(False, "walks with the group along its way (section `walk`), from x, y")
    behind: tuple[float, ...] = _field(
        (), "a member: when they begin to fall behind, and how long they stay far behind (4.6 m "
        "along the way) before they catch up [s]",
        kind="floats", length=2,
    )  # fmt: skip
    leaves: float = _field(
        -1.0, "a member: when they leave for their goal; -1: never [s]", low=-1.0, high=1e6
    )
    joins: float = _field(
        -1.0, "a member: waits until then, then joins the group; -1: is with it [s]",
        low=-1.0, high=1e6,
    )  # fmt: skip
    turn_rate: float = _field(0.0, "turns on the spot [rad/s]", low=-6.0, high=6.0)
    height: float = _field(0.0, "1.45 to 1.95 is usual; 0: at random [m]", low=0.0, high=2.3)
    build: float = _field(0.0, "girth, 1 is average; 0: at random", low=0.0, high=1.6)
    top: str = _field(
        "random",
        "what covers the upper body",
        choices=("random", "pullover", "shirt", "jacket", "coat"),
    )
    bottom: str = _field(
        "random", "what covers the legs", choices=("random", "trousers", "skirt", "shorts")
    )
    cloth: str = _field(
        "random",
        "texture of the upper garment",
        choices=("random", "plain", "knit", "stripes", "checks", "print", "denim", "blocks"),
    )
    shade: float = _field(0.0, "its reflectance, 0.05 is black; 0: at random", low=0.0, high=0.95)
    hair: str = _field(
        "random",
        "hair, or what covers it",
        choices=("random", "short", "long", "bald", "cap", "hat", "hood", "bun"),
    )
    bag: str = _field(
        "random",
        "what is carried: on the back, at the shoulder, in a hand, a box before the chest, or a "
        "coat over the arm",
        choices=("random", "none", "backpack", "shoulder", "hand", "box", "coat"),
    )
    lean: float = _field(
        0.0, "the head is so much farther ahead of the hips than usual, and x, y are midway "
        "between them; 0.3 is bent forward [m]",
        low=-0.1, high=0.45,
    )  # fmt: skip
    pose: str = _field(
        "random",
        "what one who stands does with their arms",
        choices=(
            "random",
            "hang",
            "pockets",
            "crossed",
            "hips",
            "phone",
            "behind",
            "talk",
            "point",
            "raised",
        ),
    )
    seed: int = _field(0, "of everything that is left to chance; 0: from the scene", low=0)


@dataclass(frozen=True)
class StereoHead(Section):
    """A stereo head and its mounting (see the robot's `mounting` parameters)."""

    width: int = _field(160, "image width [px]", low=16, high=4096)
    height_px: int = _field(120, "image height [px]", low=16, high=4096)
    focal: float = _field(105.46, "focal length [px]", low=5.0, high=10_000.0)
    cx: float = _field(-1.0, "principal point; -1: the image's middle [px]", low=-1.0, high=4096.0)
    cy: float = _field(-1.0, "principal point; -1: the image's middle [px]", low=-1.0, high=4096.0)
    baseline: float = _field(0.10, "from left to right [m]", low=0.01, high=2.0)
    top: float = _field(0.0, "third camera so far above left; 0: none [m]", low=-1.0, high=1.0)
    distortion: tuple[float, ...] = _field(
        (), "k1, k2, p1, p2, k3 of raw images; empty: rectified images", kind="floats"
    )
    calibration: tuple[str, ...] = _field(
        (), "CameraInfo YAML files of left, right (and top), instead of the numbers above"
    )
    height: float = _field(1.0, "lens height over the floor [m]", low=0.05, high=10.0)
    forward: float = _field(0.0, "lens in front of base_link [m]", low=-5.0, high=5.0)
    left: float = _field(0.0, "lens to the left of base_link [m]", low=-5.0, high=5.0)
    pitch: float = _field(0.0, "nose down [rad]", low=-1.6, high=1.6)
    roll: float = _field(0.0, "right side down [rad]", low=-3.2, high=3.2)
    yaw: float = _field(0.0, "to the left [rad]", low=-3.2, high=3.2)


@dataclass(frozen=True)
class Sonar(Section):
    """An ultrasonic range finder (topic of sensor_msgs/Range) and its mounting."""

    x: float = _field(0.0, "in front of base_link [m]", low=-5.0, high=5.0)
    y: float = _field(0.0, "to the left of base_link [m]", low=-5.0, high=5.0)
    yaw: float = _field(0.0, "where it looks, to the left [rad]", low=-_TAU, high=_TAU)
    height: float = _field(0.4, "over the floor [m]", low=0.02, high=10.0)
    field_of_view: float = _field(0.52, "its whole cone [rad]", low=0.01, high=3.0)
    specular_limit: float = _field(
        0.47, "a surface whose perpendicular is farther off its axis sends no echo; between the "
        "cone and this it sends one now and then [rad]", low=0.0, high=1.6,
    )  # fmt: skip
    min_range: float = _field(0.15, "nearest range [m]", low=0.0, high=5.0)
    max_range: float = _field(5.0, "farthest range [m]", low=0.1, high=50.0)
    noise: float = _field(0.01, "standard deviation, relative to the range", low=0.0, high=0.5)
    least_noise: float = _field(0.005, "standard deviation at range 0 [m]", low=0.0, high=1.0)
    dropout: float = _field(0.02, "share of ranges that are missed", low=0.0, high=1.0)
    cross_talk: float = _field(
        0.02, "share of ranges that are too short by the sound of another sonar of the robot",
        low=0.0, high=1.0,
    )  # fmt: skip
    edge_echo: float = _field(0.5, "how often an edge sends an echo", low=0.0, high=1.0)
    cloth_echo: float = _field(0.8, "how often a person sends an echo", low=0.0, high=1.0)


@dataclass(frozen=True)
class Laser(Section):
    """A laser scanner with a level plane (sensor_msgs/LaserScan) and its mounting."""

    x: float = _field(0.0, "in front of base_link [m]", low=-5.0, high=5.0)
    y: float = _field(0.0, "to the left of base_link [m]", low=-5.0, high=5.0)
    yaw: float = _field(0.0, "where its middle looks, to the left [rad]", low=-_TAU, high=_TAU)
    height: float = _field(0.3, "over the floor [m]", low=0.02, high=10.0)
    field_of_view: float = _field(4.7124, "angle that it covers [rad]", low=0.01, high=_TAU)
    rays: int = _field(360, "ranges per scan", low=1, high=10_000)
    rate: float = _field(10.0, "scans per second [Hz]", low=0.1, high=200.0)
    min_range: float = _field(0.05, "nearest range [m]", low=0.0, high=5.0)
    max_range: float = _field(10.0, "farthest range [m]", low=0.1, high=500.0)
    noise: float = _field(0.01, "standard deviation of a range [m]", low=0.0, high=1.0)
    dropout: float = _field(0.005, "share of ranges that are missed", low=0.0, high=1.0)


@dataclass(frozen=True)
class Robot(Section):
    """One robot. Without a path it stands."""

    x: float = _field(0.0, "base_link in the map [m]", low=-1000.0, high=1000.0)
    y: float = _field(0.0, "base_link in the map [m]", low=-1000.0, high=1000.0)
    yaw: float = _field(0.0, "heading [rad]", low=-_TAU, high=_TAU)
    path: tuple[float, ...] = _field((), "x0, y0, x1, y1, ... to drive along [m]", kind="floats")
    speed: float = _field(0.8, "driving speed [m/s]", low=0.0, high=3.0)
    backwards: bool = _field(False, "drives with its back ahead, as one who looks at followers")
    post: tuple[float, ...] = _field(
        (), "its place in the formation that drives with the group (section `walk`): so far ahead "
        "of the group's middle along the way, and so far to its left; it drives in any direction "
        "and looks at the group [m]", kind="floats", length=2,
    )  # fmt: skip
    sweeps: bool = _field(False, "its post is measured from the last member, not from the middle")
    phase: float = _field(
        0.0, "its images are this much later than the frame [s]", low=0.0, high=1.0
    )
    body: str = _field("mast", "how it looks", choices=("mast", "column", "none"))
    slip: tuple[float, ...] = _field(
        (), "when its wheels slip [s], and how far ahead, to the left [m] and turned to the left "
        "[rad] `drift` odometry then is at once, although the robot is not",
        kind="floats", length=4,
    )  # fmt: skip
    carried: tuple[float, ...] = _field(
        (), "when it is carried [s], and how far ahead, to the left [m] and turned to the left "
        "[rad] it then is at once, and stays, without `drift` odometry seeing it",
        kind="floats", length=4,
    )  # fmt: skip
    wheels: tuple[float, ...] = _field(
        (), "systematic errors of its wheels: the true way is longer than in `drift` odometry by "
        "this share, the true turn is greater by this many radians per metre ahead, and by this "
        "share", kind="floats", length=3,
    )  # fmt: skip
    bumps: tuple[float, ...] = _field(
        (), "thresholds and the like: one in so many metres on average, and the standard "
        "deviations of what `drift` odometry then is wrong by at once, ahead and to the left [m] "
        "and in its heading [rad]", kind="floats", length=3,
    )  # fmt: skip
    frozen: tuple[float, ...] = _field(
        (), "when `drift` odometry hangs, and for how long [s]: it repeats its last pose, and goes "
        "on from there without the way in between", kind="floats", length=2,
    )  # fmt: skip
    catches_up: bool = _field(False, "odometry that hung goes on with the way in between")


@dataclass(frozen=True)
class Imaging(Section):
    """From light to grey levels. Differences are drawn once per camera."""

    samples: int = _field(4, "rays per pixel", low=1, high=64)
    target: float = _field(105.0, "mean grey level that exposure aims at", low=10.0, high=240.0)
    noise: float = _field(2.0, "noise of a pixel in the dark [grey levels]", low=0.0, high=50.0)
    shot_noise: float = _field(
        0.08, "noise that grows with the root of the grey level", low=0.0, high=2.0
    )
    gain_difference: float = _field(0.02, "deviation of gains, relative", low=0.0, high=0.5)
    brightness_difference: float = _field(
        1.0, "deviation of offsets [grey levels]", low=0.0, high=50.0
    )
    vignetting: float = _field(0.10, "loss of light in the corners", low=0.0, high=0.9)
    blur: float = _field(0.4, "Gaussian blur of the lens, sigma [px]", low=0.0, high=5.0)
    exposure: float = _field(0.008, "exposure time, for motion blur [s]", low=0.0, high=0.1)
    slices: int = _field(2, "instants that are averaged while exposing", low=1, high=16)
    calibration_error: float = _field(
        0.05, "deviation of the cameras' orientation from calibration [px]", low=0.0, high=5.0
    )
    gamma: float = _field(1.0, "grey = light ** gamma; 1: linear", low=0.2, high=3.0)


@dataclass(frozen=True)
class Odometry(Section):
    """What the robots say about their poses.

    `exact`: the truth, in `map`. `localized`: in `map`, with a slowly wandering error of the given
    sigmas. `drift`: in `<robot>/odom`, whose place in the map is known from the start (parameter
    `pose.map_from_odom`), with an error that grows with the way. The covariance says how large the
    error is expected to be.
    """

    mode: str = _field("exact", "kind of error", choices=("exact", "localized", "drift"))
    rate: float = _field(50.0, "messages per second [Hz]", low=1.0, high=1000.0)
    sigma: float = _field(
        0.015, "localized, and at the start of drift: position [m]", low=0.0, high=1.0
    )
    sigma_yaw: float = _field(0.005, "the same for the heading [rad]", low=0.0, high=1.0)
    period: float = _field(5.0, "localized: the error changes within this time [s]", low=0.1)
    drift: float = _field(
        0.03, "drift: position per root of the way [m / sqrt(m)]", low=0.0, high=1.0
    )
    drift_yaw: float = _field(
        0.01, "drift: heading per root of the way [rad / sqrt(m)]", low=0.0, high=1.0
    )


@dataclass(frozen=True)
class Layout(Section):
    """Numbers from which `layouts.py` makes people, robots and furniture at random."""

    people: int = _field(0, "people", low=0, high=30)
    robots: int = _field(0, "robots around them", low=0, high=8)
    activity: str = _field(
        "stand",
        "what people do: stand about, talk in pairs, stand closely together, follow the first "
        "robot, walk about, a mixture of standing and walking, walk as a group (section `walk`), "
        "or wait where the scene's tour begins",
        choices=("stand", "talk", "close", "tour", "walk", "mixed", "group", "guided"),
    )
    heads: str = _field(
        "level",
        "level at 1 m; tilted: up to 2.4 m, 30 deg and 10 deg of roll; mixed; trinocular for the "
        "first robot; or varied: another head for each robot, 0.7 to 2.4 m high, level, tilted up "
        "or nose down, of 5 to 25 px m (focal length times baseline)",
        choices=("level", "tilted", "mixed", "trinocular", "varied"),
    )
    furniture: int = _field(0, "pieces of furniture", low=0, high=60)
    clutter: int = _field(0, "small things", low=0, high=60)
    near: float = _field(1.5, "robots are at least so far from the group's middle [m]", low=0.3)
    far: float = _field(3.2, "robots are at most so far from the group's middle [m]", low=0.3)
    cloth: str = _field(
        "random", "clothes: random, or dark pullovers only", choices=("random", "dark")
    )
    variety: bool = _field(
        False, "every kind of furniture, in various sizes, and people who carry things, lean, "
        "raise their arms or wear hats; otherwise the usual kinds of the published suite",
    )  # fmt: skip


@dataclass(frozen=True)
class Walk(Section):
    """How the group walks: the members among `people`, or those that `layout` adds (`group`).

    The last four are for `layout` alone: how many of its people do that, and who else comes.
    """

    path: tuple[float, ...] = _field(
        (), "x0, y0, x1, y1, ... of the way; empty: along the middle of the room [m]",
        kind="floats",
    )  # fmt: skip
    loop: bool = _field(False, "the way's end leads to its beginning; else the group stops there")
    speed: float = _field(0.85, "how fast the group walks [m/s]", low=0.1, high=2.0)
    width: float = _field(1.6, "of the way that its members take up [m]", low=0.0, high=20.0)
    gap: float = _field(
        0.8, "how close members like to be; 0.5 is a dense group [m]", low=0.4, high=3.0
    )
    wander: float = _field(
        1.0, "how much they change places; 0: each keeps theirs", low=0.0, high=4.0
    )
    dawdle: float = _field(
        0.5, "how often each stops for a moment to look at something [1/min]", low=0.0, high=20.0
    )
    stragglers: int = _field(0, "members who fall behind for a while", low=0, high=10)
    leavers: int = _field(0, "members who walk off", low=0, high=10)
    joiners: int = _field(0, "members who wait on the way and join", low=0, high=10)
    strangers: int = _field(0, "people who come towards or across", low=0, high=30)


@dataclass(frozen=True)
class Followers(Section):
    """What people do who are guided on the scene's tour (`mrs tour --simulate`)."""

    stragglers: int = _field(0, "people who stop on the way to look at something", low=0, high=10)
    stay: float = _field(
        40.0, "how long they stay, unless a robot comes to them [s]", low=0.0, high=3600.0
    )
    leavers: int = _field(
        0, "people who leave for good on the way, back to where it began", low=0, high=10
    )


@dataclass(frozen=True)
class Bystander(Section):
    """Somebody on a guided tour who is not of the group: they walk along a path, or stand."""

    path: tuple[float, ...] = _field(
        (), "x0, y0, x1, y1, ... of their way; one point: they stand there [m]", kind="floats"
    )
    speed: float = _field(1.2, "walking speed [m/s]", low=0.1, high=3.0)
    near: float = _field(
        0.0, "they set out once the leading robot is so near to them; 0: at once [m]",
        low=0.0, high=200.0,
    )  # fmt: skip
    waits: float = _field(0.0, "... and so much later [s]", low=0.0, high=3600.0)
    ignores: bool = _field(False, "walks as if there were no robots")


@dataclass(frozen=True)
class Visibility(Section):
    """Whom `/ground_truth/visible` calls seen: enough of a person, within the working range."""

    range: float = _field(
        5.0, "a robot sees nobody who is farther away [m]; the paper's working range is 5 m",
        low=0.1,
    )  # fmt: skip
    share: float = _field(
        0.25, "least share of a whole person at that range that the left image shows",
        low=0.0, high=1.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A whole scene, see the module's docstring.

    Attributes:
        name: Its name.
        seed: Of everything that is left to chance.
        description: For people.
        timing: When images are taken.
        room: Floor, walls and light.
        furniture: What stands in it.
        people: Who is there; the index is the person's.
        robots: The team, by name.
        heads: Each robot's stereo head, by its name.
        sonars: Each robot's sonars, by its name; they fire together.
        lasers: The laser scanners of robots that have one, by the robot's name.
        imaging: From light to grey levels.
        odometry: What the robots say about their poses.
        visibility: Whom a robot sees.
        layout: What is added at random.
        walk: How the group walks.
        followers: What people do who are guided.
        bystanders: Who is there and is not guided.
        tour: Where they are guided, as the file of a tour holds it; empty: nowhere.
        tracks: A file of recorded pedestrians (`obsmat.txt`), or "".
        tracks_window: First and last time of the recording to be used [s], and the x, y that
            become the map's origin [m].
    """

    name: str = "scene"
    seed: int = 1
    description: str = ""
    timing: Timing = Timing()
    room: Room = Room()
    furniture: tuple[Furniture, ...] = ()
    people: tuple[Person, ...] = ()
    robots: Mapping[str, Robot] = dataclasses.field(default_factory=dict)
    heads: Mapping[str, StereoHead] = dataclasses.field(default_factory=dict)
    sonars: Mapping[str, tuple[Sonar, ...]] = dataclasses.field(default_factory=dict)
    lasers: Mapping[str, Laser] = dataclasses.field(default_factory=dict)
    imaging: Imaging = Imaging()
    odometry: Odometry = Odometry()
    visibility: Visibility = Visibility()
    layout: Layout = Layout()
    walk: Walk = Walk()
    followers: Followers = Followers()
    bystanders: tuple[Bystander, ...] = ()
    tour: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    tracks: str = ""
    tracks_window: tuple[float, ...] = ()


def read_scene(document: object, where: str, *, seed: int | None = None) -> Scene:
    """Builds a scene from what a YAML file holds.

    Args:
        document: The parsed file.
        where: Its name, for errors.
        seed: Instead of the file's.

    Raises:
        ConfigError: A key is unknown (the nearest one is suggested) or a value not allowed.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(f"{where}: is not a scene (a mapping with room, people, robots, ...)")
    try:
        for key in document:
            if key not in _KNOWN:
                raise ConfigError(f"unknown section {key}; {suggestion(str(key), _KNOWN)}")
        values = {name: read(document[name]) for name, read in _READERS.items() if name in document}
        scene = Scene(**{"name": Path(where).stem, **values, **_read_team(document)})
        if seed is not None:
            scene = dataclasses.replace(scene, seed=_whole(seed))
        _check(scene)
    except (ConfigError, TypeError, ValueError) as err:
        raise ConfigError(f"{where}: {err}") from err
    return scene


def load_scene(path: str | Path, *, seed: int | None = None) -> Scene:
    """Reads a scene file; paths in it are relative to it.

    Raises:
        ConfigError: It cannot be read, a key is unknown or a value not allowed.
    """
    path = Path(path)
    scene = read_scene(load_yaml(path), str(path), seed=seed)
    if scene.tracks:
        scene = dataclasses.replace(scene, tracks=str(path.parent / scene.tracks))
    heads = {
        name: dataclasses.replace(
            head, calibration=tuple(str(path.parent / file) for file in head.calibration)
        )
        for name, head in scene.heads.items()
    }
    return dataclasses.replace(scene, heads=heads)


def _check(scene: Scene) -> None:
    """What several sections, or several keys of one, have to agree on."""
    for kind, items in (("people", scene.people), ("robots", scene.robots.values())):
        for item in items:
            _check_path(item.path, kind)
    _check_path(scene.walk.path, "walk")
    for bystander in scene.bystanders:
        if not bystander.path:
            raise ConfigError("bystanders: path is empty; wanted x0, y0, ...: a point at least")
        if len(bystander.path) != 2:
            _check_path(bystander.path, "bystanders")
    if scene.bystanders and not scene.tour:
        raise ConfigError("has bystanders, but no tour; wanted: both")
    lasts_s = (scene.timing.frames - 1) / scene.timing.rate
    if lasts_s > _MAX_S:
        raise ConfigError(
            f"timing: {scene.timing.frames} frames at {scene.timing.rate:g} Hz last "
            f"{lasts_s:.0f} s; allowed: {_MAX_S}"
        )
    if len(scene.tracks_window) not in (0, 4):
        raise ConfigError("tracks_window wants four numbers: first and last time, x, y")


def _check_path(path: tuple[float, ...], kind: str) -> None:
    if len(path) % 2 or len(path) == 2:
        raise ConfigError(
            f"{kind}: path has {len(path)} numbers; wanted x0, y0, x1, y1, ...: at least two points"
        )
    points = list(zip(path[::2], path[1::2], strict=True))
    length_m = sum(map(math.dist, points, points[1:]))
    if length_m > _MAX_PATH_M:
        raise ConfigError(f"{kind}: path is {length_m:.0f} m long; allowed: {_MAX_PATH_M}")


def _mapping(value: object, name: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{name} is {value!r}; wanted: a mapping")
    return value


def _section(kind: type[Section], name: str, value: object) -> Any:
    """A section from what the file holds; nothing there: its defaults."""
    return kind.from_mapping(_mapping(value or {}, name))


def _list(kind: type[Section], name: str, value: object) -> tuple:
    if value is None:
        return ()
    if not isinstance(value, list):
        raise ConfigError(f"{name} is {value!r}; wanted: a list")
    return tuple(kind.from_mapping(_mapping(item, f"{name}[{i}]")) for i, item in enumerate(value))


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ConfigError(f"seed is {value!r}; allowed: a whole number of at least 0")
    return value


def _read_team(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The robots and what each carries; `head`, `sonars` and `laser` beside them are of all."""
    common = _section(StereoHead, "head", document.get("head"))
    robots, heads, sonars, lasers = {}, {}, {}, {}
    for name, body in _mapping(document.get("robots") or {}, "robots").items():
        where = f"robots.{name}"
        values = dict(_mapping(body or {}, where))
        heads[name] = StereoHead.from_mapping(_mapping(values.pop("head", {}), "head"), common)
        if given := values.pop("sonars", document.get("sonars")):
            sonars[name] = _list(Sonar, f"{where}.sonars", given)
        if "laser" in values or "laser" in document:
            laser = values.pop("laser", document.get("laser"))
            lasers[name] = _section(Laser, f"{where}.laser", laser)
        robots[name] = Robot.from_mapping(values)
    PlannerConfig(robots=tuple(robots))  # knows which names are allowed
    return {"robots": robots, "heads": heads or {"": common}, "sonars": sonars, "lasers": lasers}


#: How the value of a key becomes a field of `Scene`.
_READERS: dict[str, Callable[[Any], Any]] = {
    "name": str,
    "seed": _whole,
    "description": str,
    "timing": partial(_section, Timing, "timing"),
    "room": partial(_section, Room, "room"),
    "furniture": partial(_list, Furniture, "furniture"),
    "people": partial(_list, Person, "people"),
    "imaging": partial(_section, Imaging, "imaging"),
    "odometry": partial(_section, Odometry, "odometry"),
    "visibility": partial(_section, Visibility, "visibility"),
    "layout": partial(_section, Layout, "layout"),
    "walk": partial(_section, Walk, "walk"),
    "followers": partial(_section, Followers, "followers"),
    "bystanders": partial(_list, Bystander, "bystanders"),
    "tour": lambda value: _mapping(value or {}, "tour"),
    "tracks": str,
    "tracks_window": lambda value: tuple(map(float, value)),
}
#: Those of the team are read together; the suite's `half` is not the scene's.
_KNOWN = (*_READERS, "robots", "head", "sonars", "laser", "half")
