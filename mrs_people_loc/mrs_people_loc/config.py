"""Configuration: frozen, validated, and the one place of every default.

Each field states its meaning, unit and allowed range; ROS parameters, the YAML files in `config/`
and the tables in the documentation derive from these definitions. Lengths are metres, times
seconds, angles radians, unless the name says otherwise (`_px`). The paper's constants are those of
Martinez-Garcia, Ohya & Yuta (2004); `config/paper.yaml` holds them.

A parameter file is an ordinary ROS 2 parameter file, and one file describes a team::

    /**/robot_node:            # every robot
      ros__parameters:
        zones: {low: 0.20, high: 1.40}
    /robot_a/robot_node:       # one robot; later sections win
      ros__parameters:
        mounting: {height: 1.10}
    /**/planner_node:
      ros__parameters:
        robots: [robot_a, robot_b]

Sections of other nodes, such as a camera's driver, are left alone; but a name that is nearly that
of one of ours (`/robot_a/robto_node`) is an error.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from mrs_people_loc.errors import ConfigError

Value = Any  # bool | int | float | str | tuple[float, ...] | tuple[str, ...]

_SectionT = TypeVar("_SectionT", bound="Section")

_TYPE_NAMES = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "str": "a text",
    "floats": "a list of numbers",
    "strs": "a list of texts",
}


@dataclass(frozen=True)
class Parameter:
    """Definition of one configuration field, by its dotted name.

    Attributes:
        name: Dotted name, such as `zones.low`.
        kind: One of bool, int, float, str, floats, strs.
        default: Default value.
        doc: What it means, with its unit.
        low: Smallest allowed value, inclusive; None without limit.
        high: Largest allowed value, inclusive; None without limit.
        choices: The allowed texts; empty for any.
        odd: Whether the number must be odd.
        length: Exact length of a list; None for any.
        live: Whether a running node takes a change.
    """

    name: str
    kind: str
    default: Value
    doc: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    odd: bool = False
    length: int | None = None
    live: bool = True

    def allowed(self) -> str:
        """Says in words which values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        text = "an odd whole number" if self.odd else _TYPE_NAMES[self.kind]
        if self.length is not None:
            text += f" of length {self.length}"
        if self.low is not None and self.high is not None:
            text += f" from {self.low:g} to {self.high:g}"
        elif self.low is not None:
            text += f" of at least {self.low:g}"
        return text

    def check(self, value: object) -> Value:
        """Returns `value` in this field's type.

        Raises:
            ConfigError: Naming the field, the value and what is allowed.
        """
        checked = self._convert(value)
        if checked is None:
            raise ConfigError(f"{self.name} is {value!r}; allowed: {self.allowed()}")
        return checked

    def _convert(self, value: object) -> Value | None:
        if self.kind == "bool":
            return value if isinstance(value, bool) else None
        if self.kind == "str":
            ok = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if ok else None
        if self.kind in ("floats", "strs"):
            if isinstance(value, (str, bytes)) or not hasattr(value, "__iter__"):
                return None
            items = tuple(value)
            if self.length is not None and len(items) not in (0, self.length):
                return None
            if self.kind == "strs":
                return items if all(isinstance(item, str) and item for item in items) else None
            return tuple(float(i) for i in items) if all(map(_is_number, items)) else None
        if not _is_number(value):
            return None
        assert isinstance(value, (int, float))
        if self.kind == "int":
            if value != int(value) or (self.odd and value % 2 == 0):
                return None
            value = int(value)
        else:
            value = float(value)
        if self.low is not None and value < self.low:
            return None
        if self.high is not None and value > self.high:
            return None
        return value


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


def _field(default: Value, doc: str, **limits: Any) -> Any:
    """A dataclass field with its definition (see `Parameter`) as metadata."""
    kind = limits.pop("kind", "strs") if isinstance(default, tuple) else type(default).__name__
    return dataclasses.field(default=default, metadata={"kind": kind, "doc": doc, **limits})


class Section:
    """A frozen dataclass of parameters and of further sections, validated when it is built."""

    def __post_init__(self) -> None:
        """Checks each value and the relations between them."""
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            if field.metadata:
                parameter = Parameter(field.name, default=field.default, **field.metadata)
                try:
                    checked = parameter.check(getattr(self, field.name))
                except ConfigError as err:
                    raise ConfigError(f"{type(self).__name__}: {err}") from None
                object.__setattr__(self, field.name, checked)
        self._check_relations()

    def _check_relations(self) -> None:
        """Raises ConfigError where values that are each allowed do not fit together."""

    @classmethod
    def parameters(cls, prefix: str = "") -> Iterator[Parameter]:
        """Yields the definition of every field, sections flattened to dotted names."""
        for field in dataclasses.fields(cls):  # type: ignore[arg-type]
            if field.metadata:
                yield Parameter(prefix + field.name, default=field.default, **field.metadata)
            else:
                section: Any = field.default_factory
                yield from section.parameters(f"{prefix}{field.name}.")

    @classmethod
    def from_mapping(
        cls: type[_SectionT], values: Mapping[str, Any], base: _SectionT | None = None
    ) -> _SectionT:
        """Builds the configuration from nested or dotted names; what is not named stays.

        Args:
            values: `{"zones": {"low": 0.2}}` or `{"zones.low": 0.2}`.
            base: What stays where nothing is named; the defaults if None.

        Raises:
            ConfigError: A name is unknown (the nearest one is suggested) or a value not allowed.
        """
        known = {parameter.name: parameter for parameter in cls.parameters()}
        flat = _flatten(values)
        for name in flat:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1, 0.5)
                hint = f"; did you mean {near[0]}?" if near else f"; known: {', '.join(known)}"
                raise ConfigError(f"unknown parameter {name}{hint}")
        checked = {name: known[name].check(value) for name, value in flat.items()}
        return (base or cls())._replace(checked)

    def _replace(self: _SectionT, flat: Mapping[str, Value]) -> _SectionT:
        own = {name: value for name, value in flat.items() if "." not in name}
        inner: dict[str, dict[str, Value]] = {}
        for name, value in flat.items():
            if "." in name:
                section, rest = name.split(".", 1)
                inner.setdefault(section, {})[rest] = value
        own.update({name: getattr(self, name)._replace(part) for name, part in inner.items()})
        return dataclasses.replace(self, **own)  # type: ignore[type-var]

    def to_mapping(self) -> dict[str, Any]:
        """Returns nested plain values, as a YAML parameter file holds them."""
        result: dict[str, Any] = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, Section):
                value = value.to_mapping()
            result[field.name] = list(value) if isinstance(value, tuple) else value
        return result


def _flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat


# -------------------------------------------------------------------------------- robot ----


@dataclass(frozen=True)
class Images(Section):
    """Which images come in, and how they pair."""

    rectified: bool = _field(
        True, "true: image_rect is used as it is; false: image_raw is rectified here", live=False
    )
    top: bool = _field(False, "true: a third camera `top` above (or below) `left`", live=False)
    working_width: int = _field(
        160, "larger images are scaled down to fit this width [px]", low=32, high=4096
    )
    working_height: int = _field(
        120, "larger images are scaled down to fit this height [px]", low=24, high=4096
    )
    max_stamp_difference: float = _field(
        0.005, "images whose stamps differ by up to this form a pair; 0: same stamp [s]",
        low=0.0, high=1.0,
    )  # fmt: skip
    queue_size: int = _field(8, "images per camera that wait for their pair", low=1, high=100)


@dataclass(frozen=True)
class Mounting(Section):
    """Where the head sits: pose of the left (reference) camera in the robot's base_link.

    Angles turn as REP 103 says: first yaw (to the left), then pitch (nose down), then roll (right
    side down), each about the axis that the former left. Zero: level, looking ahead.
    """

    height: float = _field(1.0, "lens height over the floor [m]", low=0.0, high=20.0)
    forward: float = _field(0.0, "lens in front of base_link's origin [m]", low=-5.0, high=5.0)
    left: float = _field(0.0, "lens to the left of base_link's origin [m]", low=-5.0, high=5.0)
    pitch: float = _field(
        0.0, "nose down is positive; pi/2 looks straight down [rad]", low=-math.pi, high=math.pi
    )
    roll: float = _field(0.0, "right side down is positive [rad]", low=-math.pi, high=math.pi)
    yaw: float = _field(0.0, "turned to the left is positive [rad]", low=-math.pi, high=math.pi)


@dataclass(frozen=True)
class Disparity(Section):
    """Stereo matching with OpenCV's StereoBM (SAD)."""

    pre_filter: str = _field(
        "xsobel", "StereoBM's pre-filter, in place of the head's edge filter",
        choices=("xsobel", "normalized_response"),
    )  # fmt: skip
    pre_filter_size_px: int = _field(
        11, "window of normalized_response [px] (the paper's edge mask)",
        low=5, high=255, odd=True,
    )  # fmt: skip
    pre_filter_cap: int = _field(63, "pre-filter output is cut here", low=1, high=63)
    block_size_px: int = _field(
        7, "SAD window [px] (the paper's stereo mask is 15)", low=5, high=51, odd=True
    )
    fill_block_size_px: int = _field(
        11, "pixels without a disparity get that of a second pass with this window [px], an odd "
        "number from 5; 0: no second pass",
        low=0, high=51,
    )  # fmt: skip
    min_range: float = _field(0.7, "nearest working depth [m]", low=0.1, high=50.0)
    max_range: float = _field(5.0, "farthest working depth [m]", low=0.2, high=100.0)
    uniqueness_ratio: int = _field(
        10, "margin of the best over the second best match [%]", low=0, high=100
    )
    texture_threshold: int = _field(
        10, "least sum of absolute pre-filter output over the block", low=0, high=100_000
    )
    left_right_difference_px: int = _field(
        1, "left and right match must agree within this [px]; -1: not checked", low=-1, high=16
    )
    trinocular_difference_px: float = _field(
        1.0, "horizontal and vertical pair must agree within this [px]", low=0.0, high=16.0
    )

    def _check_relations(self) -> None:
        if self.fill_block_size_px and (
            self.fill_block_size_px % 2 == 0 or self.fill_block_size_px < 5
        ):
            raise ConfigError(
                f"disparity.fill_block_size_px is {self.fill_block_size_px}; "
                "allowed: 0 or an odd whole number from 5 to 51"
            )
        if self.min_range >= self.max_range:
            raise ConfigError(
                f"disparity.min_range is {self.min_range:g}; "
                f"allowed: less than disparity.max_range, {self.max_range:g}"
            )


@dataclass(frozen=True)
class Sight(Section):
    """When a head is taken to be blind: its diagnostics say so."""

    min_valid: float = _field(
        0.25, "least share of pixels with a disparity; 0: not looked at", low=0.0, high=1.0
    )
    frames: int = _field(
        5, "so many views in a row must be bad before it is said, and good before it is taken back",
        low=1, high=1000,
    )  # fmt: skip


@dataclass(frozen=True)
class Floor(Section):
    """Whether the mounting fits the floor in view: diagnostics say when it does not."""

    watch: bool = _field(True, "true: a part of the views is searched for the floor")
    max_angle: float = _field(
        0.026, "the head may be turned by this, and twice what the floor errs by [rad]",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_height: float = _field(
        0.08, "the head may be higher or lower by this, likewise [m]", low=0.0, high=5.0
    )


@dataclass(frozen=True)
class Zones(Section):
    """Zone discrimination (eq. 1): heights over the floor that are kept."""

    low: float = _field(0.20, "knees: th1 of eq. 1 [m]", low=-1.0, high=10.0)
    high: float = _field(1.40, "shoulders: th2 of eq. 1 [m]", low=-1.0, high=10.0)

    def _check_relations(self) -> None:
        if self.low >= self.high:
            raise ConfigError(
                f"zones.low is {self.low:g}; allowed: less than zones.high, {self.high:g}"
            )


@dataclass(frozen=True)
class Noise(Section):
    """Noise reduction (eqs. 2-3)."""

    window: float = _field(0.10, "side of a noise window: fwin of eq. 2 [m]", low=0.01, high=2.0)
    min_points: int = _field(
        20, "a window with fewer points is emptied: th_n of eq. 3", low=1, high=100_000
    )


@dataclass(frozen=True)
class Quantization(Section):
    """Point reduction (eqs. 4-5)."""

    cell: float = _field(0.05, "side of a cell: hwin of eq. 4 [m]", low=0.01, high=1.0)
    top_support: int = _field(
        5, "so many points at or above it make the top of a column", low=1, high=1000
    )
    top_gap: float = _field(
        0.25, "a column ends where no point follows within this height [m]", low=0.05, high=2.0
    )


@dataclass(frozen=True)
class Bodies(Section):
    """People sought as bodies, in place of the paper's noise windows and cells."""

    search: bool = _field(
        True, "true: people are sought as upright bodies in bearing and inverse range; false: the "
        "paper's zones, noise windows and cells"
    )  # fmt: skip
    max_range: float = _field(6.0, "farthest range of a body [m]", low=0.5, high=50.0)
    min_extent: float = _field(
        0.35, "least vertical extent seen, mean over a body's width [m]", low=0.05, high=2.0
    )
    max_count: int = _field(16, "so many candidates per view at most", low=1, high=100)
    vote: bool = _field(True, "true: all pixels of a body vote on one disparity")
    human_test: bool = _field(
        True, "true: a fitted model says how likely a body is a person; false: its vertical extent "
        "stands for it; fitted with bodies.vote"
    )  # fmt: skip
    axis: bool = _field(
        True, "true: fitted offsets move a body from the surface that was seen to its axis; needs "
        "bodies.vote"
    )  # fmt: skip
    min_score: float = _field(
        -3.0, "bodies with at least these log-odds of being a person go out", low=-20.0, high=20.0
    )

    def _check_relations(self) -> None:
        if self.axis and not self.vote:
            raise ConfigError("bodies.axis is true but bodies.vote is false; allowed: both true")


@dataclass(frozen=True)
class PoseInput(Section):
    """Where the robot's pose comes from, and how often it goes out."""

    source: str = _field(
        "odom", "where the pose comes from: nav_msgs/Odometry on `odom`, "
        "geometry_msgs/PoseWithCovarianceStamped on `pose_in`, the parameter pose.static (static), "
        "or TF (tf), which needs tf2_ros",
        choices=("odom", "pose_in", "static", "tf"), live=False,
    )  # fmt: skip
    static: tuple[float, ...] = _field(
        (), "x, y [m] and yaw [rad] of base_link in the map, where it stands (source static)",
        kind="floats", length=3,
    )  # fmt: skip
    sigmas: tuple[float, ...] = _field(
        (), "standard deviations of x, y [m] and yaw [rad] of a pose that comes without (source "
        "static or tf), at least 0; empty: it is exact",
        kind="floats", length=3,
    )  # fmt: skip
    map_from_odom: tuple[float, ...] = _field(
        (), "x, y [m] and yaw [rad] of the odometry's frame in the map, for poses that are not in "
        "the map already; empty: as TF says, where tf2_ros is installed",
        kind="floats", length=3,
    )  # fmt: skip
    publish_tf: str = _field(
        "auto", "what TF is told besides the cameras, where tf2_msgs is installed: auto (map to "
        "base_link for source static and for odometry in the map; map to the odometry's frame with "
        "map_from_odom), always (map to base_link: nobody else may place it), never (no cameras)",
        choices=("auto", "always", "never"), live=False,
    )  # fmt: skip
    map_frame: str = _field("map", "the common frame", live=False)
    max_rate: float = _field(100.0, "poses published per second, at most [Hz]", low=1.0, high=1e3)

    def _check_relations(self) -> None:
        if self.source == "tf" and self.publish_tf == "always":
            raise ConfigError(
                "pose.publish_tf is always; allowed where pose.source is tf: auto, never"
            )
        if any(sigma < 0 for sigma in self.sigmas):
            raise ConfigError(f"pose.sigmas is {list(self.sigmas)}; allowed: numbers of at least 0")


@dataclass(frozen=True)
class RobotConfig(Section):
    """Configuration of one robot: from its images to its scan."""

    images: Images = dataclasses.field(default_factory=Images)
    mounting: Mounting = dataclasses.field(default_factory=Mounting)
    disparity: Disparity = dataclasses.field(default_factory=Disparity)
    sight: Sight = dataclasses.field(default_factory=Sight)
    floor: Floor = dataclasses.field(default_factory=Floor)
    zones: Zones = dataclasses.field(default_factory=Zones)
    noise: Noise = dataclasses.field(default_factory=Noise)
    quantization: Quantization = dataclasses.field(default_factory=Quantization)
    bodies: Bodies = dataclasses.field(default_factory=Bodies)
    pose: PoseInput = dataclasses.field(default_factory=PoseInput)


# ------------------------------------------------------------------------------ planner ----


@dataclass(frozen=True)
class Interval(Section):
    """When an interval closes."""

    max_wait: float = _field(
        0.1, "after the first scan the others have this long [s]", low=0.0, high=5.0
    )
    max_scan_age: float = _field(
        0.25, "a scan that is older than the newest by more is left out [s]", low=0.0, high=5.0
    )
    max_pose_age: float = _field(
        0.25, "a scan is placed with poses no farther from its stamp than this [s]",
        low=0.0, high=5.0,
    )  # fmt: skip
    robot_timeout: float = _field(
        2.0,
        "a robot that is silent for longer is not waited for, and what is seen where it "
        "was is not taken for it [s]",
        low=0.1,
        high=60.0,
    )
    max_clock_offset: float = _field(
        0.2, "a robot whose clock differs by more from that of the robot nearest to the planner's "
        "clock is left out [s]",
        low=0.001, high=5.0,
    )  # fmt: skip
    scan_rate: float = _field(
        0.0, "scans expected of each robot per second, of which half are enough; 0: as many as the "
        "fastest delivers [Hz]",
        low=0.0, high=1000.0,
    )  # fmt: skip
    walking_speed: float = _field(
        0.7, "a scan older than the interval's newest is less sure of where people are, by so much "
        "per second [m/s]; 0: it is not",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Clustering(Section):
    """Clustering based segmentation (eqs. 8-10)."""

    distance: float = _field(
        0.15, "points within this distance belong together: d_th [m]", low=0.01, high=2.0
    )


@dataclass(frozen=True)
class Splitting(Section):
    """How clusters that are more than one person are told apart."""

    max_width: float = _field(
        0.75, "a cluster that is wider than this is split into parts that are not [m]; 0: none is",
        low=0.0, high=5.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Human(Section):
    """Size of a human, as a cluster shows it. The paper says 'a priori' and prints no values.

    Heights: from a school child to a tall man; a table's edge or a chair's back is lower, a wall or
    a door higher. Width and depth: a body is 0.3 to 0.6 m; depth noise of 1/16 px and more smears
    its cells along the line of sight. Points: of a body 5 m away the zone covers about 12 x 25
    pixels of a 160 x 120 image (block matching widens it), of which half may be lost.
    """

    min_height: float = _field(1.2, "least height of the cluster's top [m]", low=0.0, high=3.0)
    max_height: float = _field(2.2, "greatest height of the cluster's top [m]", low=0.0, high=10.0)
    min_width: float = _field(0.20, "least extent along the long side [m]", low=0.0, high=5.0)
    max_width: float = _field(1.3, "greatest extent along the long side [m]", low=0.0, high=10.0)
    max_depth: float = _field(0.9, "greatest extent along the short side [m]", low=0.0, high=10.0)
    min_points: int = _field(150, "least number of 3D points in its cells", low=1, high=1_000_000)
    circle_sigmas: float = _field(
        3.0, "radius of the drawn circle, in sigmas of the cluster", low=0.0, high=10.0
    )

    def _check_relations(self) -> None:
        for low, high in (("min_height", "max_height"), ("min_width", "max_width")):
            if getattr(self, low) > getattr(self, high):
                raise ConfigError(
                    f"human.{low} is {getattr(self, low):g}; "
                    f"allowed: at most human.{high}, {getattr(self, high):g}"
                )


@dataclass(frozen=True)
class Joining(Section):
    """How the bodies that several robots found become people."""

    line_of_sight: bool = _field(
        True, "true: a body's place is less sure along the line of sight than across it; false: it "
        "is equally sure in all directions"
    )  # fmt: skip
    gate: float = _field(
        3.0, "bodies of different robots within so many sigmas are one", low=0.1, high=10.0
    )
    max_distance: float = _field(0.7, "... and within this distance [m]", low=0.05, high=5.0)
    min_score: float = _field(0.5, "log-odds from which a body is a person", low=-20.0, high=50.0)
    apart: float = _field(0.36, "two people are no closer than this [m]", low=0.0, high=2.0)
    fragment_gate: float = _field(
        5.0, "a body within so many sigmas of a likelier person whom its robots did not see is "
        "that person; 0: none is",
        low=0.0, high=20.0,
    )  # fmt: skip
    fragment_distance: float = _field(1.0, "... and within this distance [m]", low=0.0, high=5.0)


@dataclass(frozen=True)
class Masking(Section):
    """What stands at known places and is no person: robots of the team, walls, furniture."""

    robot_radius: float = _field(
        0.25, "what is within this of another robot of the team is that robot [m]; 0: robots are "
        "not told from people",
        low=0.0, high=2.0,
    )  # fmt: skip
    occupancy_grid: bool = _field(
        False, "true: the nav_msgs/OccupancyGrid on `map` says where walls and furniture are; "
        "false: nothing does",
        live=False,
    )  # fmt: skip
    occupied_from: int = _field(
        65, "cells of the grid from this value on are occupied [%]", low=1, high=100
    )
    wall_margin: float = _field(
        0.15, "nobody's axis is nearer to walls and furniture than this [m]", low=0.0, high=1.0
    )
    wall_score: float = _field(
        5.0, "log-odds of being a person that a body in a wall or in furniture loses, at most",
        low=0.0, high=50.0,
    )  # fmt: skip
    beside_score: float = _field(
        1.5, "log-odds that a body beside a wall or furniture gains, at most", low=0.0, high=50.0
    )


@dataclass(frozen=True)
class Tracking(Section):
    """How people are followed from interval to interval."""

    enabled: bool = _field(
        True, "true: people have ids, velocities and a past; false: each interval stands for "
        "itself, as in the paper"
    )  # fmt: skip
    acceleration: float = _field(
        0.5, "people change their velocity by about this much in a second, and by the square root "
        "of n times it in n seconds [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    any_velocity: float = _field(
        0.8, "standard deviation of the velocity of somebody new: people stand or walk [m/s]",
        low=0.01, high=10.0,
    )  # fmt: skip
    max_speed: float = _field(
        2.0, "nobody walks faster while he is not seen [m/s]", low=0.1, high=20.0
    )
    gate: float = _field(
        4.0, "what is found within so many sigmas of where somebody is expected may be him",
        low=0.5, high=20.0,
    )  # fmt: skip
    max_distance: float = _field(1.0, "... and within this distance [m]", low=0.1, high=10.0)
    body: float = _field(
        0.3, "... or within this, however sure both are: no two bodies are so close [m]",
        low=0.0, high=2.0,
    )  # fmt: skip
    height_sigma: float = _field(
        0.15, "standard deviation of the difference of two heights of one person [m]",
        low=0.01, high=10.0,
    )  # fmt: skip
    evidence_time: float = _field(
        0.5,
        "log-odds of being a person, height and uncertainty are means over about so long [s]",
        low=0.01,
        high=60.0,
    )
    sure_score: float = _field(
        6.0, "log-odds from which somebody new is a person at once", low=-20.0, high=8.0
    )
    birth_score: float = _field(
        1.0, "... and from which somebody is a person who is followed for tracking.birth_time",
        low=-20.0, high=8.0,
    )  # fmt: skip
    birth_time: float = _field(0.2, "see tracking.birth_score [s]", low=0.0, high=10.0)
    start_time: float = _field(
        0.35,
        "in the beginning, for so long, whoever is found and is no doubt is a person [s]",
        low=0.0,
        high=60.0,
    )
    doubt_score: float = _field(
        0.0, "log-odds from which somebody new is followed, as no person yet", low=-20.0, high=50.0
    )
    doubt_time: float = _field(
        0.25, "who is no person yet is given up when unseen for longer [s]", low=0.0, high=10.0
    )
    expected_score: float = _field(
        1.0, "log-odds that what is found gains where a person is expected", low=0.0, high=50.0
    )
    expected_points: float = _field(
        0.5, "where a person is expected a plain cluster needs this share of human.min_points",
        low=0.0, high=1.0,
    )  # fmt: skip
    keep_score: float = _field(
        -1.0, "who is a person stays one down to these log-odds", low=-20.0, high=8.0
    )
    coast_time: float = _field(
        1.0, "a person who is not seen is given up after this [s]", low=0.0, high=60.0
    )
    coast_share: float = _field(
        0.5, "... and after this share of the time for which he was seen", low=0.0, high=1e3
    )
    memory: float = _field(
        10.0, "who was given up, and is found again where he may have got to, has his id again, "
        "for so long after he was seen, and no longer than he was seen [s]; 0: nobody has",
        low=0.0, high=600.0,
    )  # fmt: skip
    lasting_share: float = _field(
        0.25, "share of the variance of what is found that stays the same from interval to "
        "interval, so that following makes nobody's place surer than this",
        low=0.0, high=1.0,
    )  # fmt: skip
    max_tracks: int = _field(
        1000, "no more people than this are followed at a time", low=1, high=10_000
    )


@dataclass(frozen=True)
class Groups(Section):
    """Who walks together, and who has fallen behind or left."""

    distance: float = _field(
        2.5, "a member who is farther than this from every other one is a straggler [m]",
        low=0.3, high=100.0,
    )  # fmt: skip
    margin: float = _field(
        0.4,
        "who comes to a group, or back to it, is nearer than groups.distance by this [m]",
        low=0.0,
        high=100.0,
    )
    speed: float = _field(
        0.8, "... and walks with it: velocities differ by no more than this [m/s]",
        low=0.0, high=20.0,
    )  # fmt: skip
    hidden_sigmas: float = _field(
        2.0, "who is hidden may be nearer than he is expected, by so many sigmas",
        low=0.0, high=20.0,
    )  # fmt: skip
    leave_time: float = _field(0.5, "a straggler is farther for so long [s]", low=0.0, high=60.0)
    join_time: float = _field(
        2.0, "who comes to a group, or back to it, is near for so long [s]", low=0.0, high=60.0
    )
    missing_time: float = _field(
        6.0, "a member who has been given up for so long is a straggler, too [s]; less than "
        "tracking.memory, so that he can come back",
        low=0.0, high=600.0,
    )  # fmt: skip
    forget_time: float = _field(
        60.0, "who has been a straggler for so long is no member any more [s]",
        low=0.0, high=3600.0,
    )  # fmt: skip


@dataclass(frozen=True)
class PlannerConfig(Section):
    """Configuration of the planner: from the robots' scans to people."""

    robots: tuple[str, ...] = _field(
        (), "names (namespaces) of the robots; empty: discovered as they appear", live=False
    )
    map_frame: str = _field("map", "the common frame", live=False)
    interval: Interval = dataclasses.field(default_factory=Interval)
    masking: Masking = dataclasses.field(default_factory=Masking)
    joining: Joining = dataclasses.field(default_factory=Joining)
    clustering: Clustering = dataclasses.field(default_factory=Clustering)
    splitting: Splitting = dataclasses.field(default_factory=Splitting)
    human: Human = dataclasses.field(default_factory=Human)
    tracking: Tracking = dataclasses.field(default_factory=Tracking)
    groups: Groups = dataclasses.field(default_factory=Groups)

    def memoryless(self) -> PlannerConfig:
        """The same, but every interval stands for itself."""
        return dataclasses.replace(self, tracking=dataclasses.replace(self.tracking, enabled=False))

    def _check_relations(self) -> None:
        for name in self.robots:
            if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name):
                raise ConfigError(
                    f"robots has {name!r}; allowed: ROS namespaces without a leading slash"
                )
        if len(set(self.robots)) < len(self.robots):
            name = next(name for name in self.robots if self.robots.count(name) > 1)
            raise ConfigError(f"robots names {name} more than once; allowed: each robot once")


# ---------------------------------------------------------------------------- the files ----

ROBOT_NODE = "robot_node"
PLANNER_NODE = "planner_node"
_CONFIG_TYPES: dict[str, type[Section]] = {ROBOT_NODE: RobotConfig, PLANNER_NODE: PlannerConfig}
#: Names of our nodes in a file; a wildcard stands for one name (*) or for any number of them (**).
_NODE_KEY = re.compile(rf"(/(\w+|\*\*?))*/({ROBOT_NODE}|{PLANNER_NODE}|\*\*?)")
#: A node whose name is as like one of ours as that is taken for a misspelling of it.
_NEARLY_OURS = 0.85
#: What PyYAML raises besides its own errors (for `!!int x`), and reading for bad UTF-8.
_YAML_SLIPS = (ValueError, LookupError, AttributeError, RecursionError)
#: Parameters that nodes have besides those of their configuration.
NODE_PARAMETERS = frozenset({"use_sim_time", "autostart", "start_type_description_service"})


@dataclass(frozen=True)
class Team:
    """What parameter files say of a team.

    Attributes:
        planner: The planner's configuration.
        robots: Configuration of each robot of the team, by name.
    """

    planner: PlannerConfig
    robots: Mapping[str, RobotConfig]


def robots_named(*paths: str | Path) -> tuple[str, ...]:
    """The robots that parameter files name: in the planner's list, or by sections of their own.

    Args:
        paths: YAML files; later ones win.

    Raises:
        ConfigError: As `load_team`.
    """
    sections = [section for path in paths for section in _read_sections(path)]
    listed = PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")).robots
    own = (key.removesuffix(ROBOT_NODE).strip("/") for _, key, _ in sections if ROBOT_NODE in key)
    return listed or tuple(dict.fromkeys(name for name in own if name and "*" not in name))


def load_team(
    *paths: str | Path,
    robots: tuple[str, ...] = (),
    unless_said: Mapping[str, Mapping[str, Value]] | None = None,
) -> Team:
    """Reads parameter files (see the module's docstring) as the nodes would.

    Args:
        paths: YAML files; later ones win.
        robots: Names of the robots, where the files do not name them.
        unless_said: By robot, parameters by dotted name that hold instead of the defaults where
            the files say nothing of them.

    Raises:
        ConfigError: A file cannot be read, is not a parameter file, or holds a bad value.
    """
    sections = [section for path in paths for section in _read_sections(path)]
    names = PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")).robots or robots
    for path, key, _ in sections:
        # Also what applies to no robot of the team is looked at.
        robot = key.strip("/").removesuffix(ROBOT_NODE).strip("/")
        if key.endswith(ROBOT_NODE) and "*" not in robot and names and robot not in names:
            raise ConfigError(
                f"{path}: section {key} is of a robot that is not in the team: {', '.join(names)}"
            )
    return Team(
        planner=PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")),
        robots={
            name: RobotConfig.from_mapping(
                {**(unless_said or {}).get(name, {}), **_merge(sections, f"/{name}/{ROBOT_NODE}")}
            )
            for name in names
        },
    )


class _Loader(yaml.SafeLoader):
    """YAML without aliases, which ROS 2 refuses in parameter files, too.

    A few lines of them can stand for more than any memory holds.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The next node, unless it is an alias."""
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                None, None, f"found an alias, *{event.anchor}; wanted: none", event.start_mark
            )
        return super().compose_node(parent, index)


def load_yaml(path: Path) -> Any:
    """What a YAML file holds.

    Raises:
        ConfigError: It cannot be read, or has aliases.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (OSError, yaml.YAMLError, *_YAML_SLIPS) as err:
        raise ConfigError(f"{path}: cannot be read as a YAML file: {err}") from err


def _read_sections(path: str | Path) -> list[tuple[Path, str, dict[str, Any]]]:
    """Sections of a file that are ours: file, key with a leading slash, flat parameters; checked.

    `~` in the path is the home folder: shells do not say so in `team:=~/team.yaml`.
    """
    path = Path(os.path.expanduser(path))
    document = load_yaml(path)
    if not isinstance(document, Mapping):
        raise ConfigError(f"{path}: is not a ROS 2 parameter file (a mapping of node names)")
    sections = []
    for key, body in _sections(document):
        node = key.rpartition("/")[2]
        config_type = _CONFIG_TYPES.get(node)
        if not _NODE_KEY.fullmatch(key):
            alike = difflib.get_close_matches(node, _CONFIG_TYPES, 1, _NEARLY_OURS)
            if not alike:
                continue  # somebody else's
            raise ConfigError(
                f"{path}: section {key} names no node of ours; did you mean .../{alike[0]}? "
                "(sections of other nodes are left alone, if their names are less like ours)"
            )
        if not isinstance(body, Mapping) or set(body) != {"ros__parameters"}:
            raise ConfigError(f"{path}: section {key} must hold `ros__parameters:` and only that")
        values = body["ros__parameters"]
        if not isinstance(values, Mapping):
            raise ConfigError(f"{path}: section {key}: ros__parameters must be a mapping")
        flat = {k: v for k, v in _flatten(values).items() if k not in NODE_PARAMETERS}
        if config_type is not None:
            try:
                config_type.from_mapping(flat)
            except ConfigError as err:
                raise ConfigError(f"{path}: section {key}: {err}") from err
        sections.append((path, key, flat))
    return sections


def _sections(document: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and bodies of a parameter file; as in ROS 2, namespaces may hold what is in them."""
    for name, body in document.items():
        key = f"{above}/{str(name).lstrip('/')}"
        node = key.rpartition("/")[2]
        ours = difflib.get_close_matches(node, _CONFIG_TYPES, 1, _NEARLY_OURS)
        inside = isinstance(body, Mapping) and body and "ros__parameters" not in body
        if inside and not ours and all(isinstance(one, Mapping) for one in body.values()):
            yield from _sections(body, key)
        else:
            yield key, body


def _merge(sections: list[tuple[Path, str, dict[str, Any]]], node: str) -> dict[str, Any]:
    """Joins the sections that match a node's full name, later ones over earlier, as rcl does."""
    merged: dict[str, Any] = {}
    for _, key, values in sections:
        pattern = re.escape(key).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
        if re.fullmatch(pattern, node):
            merged.update(values)
    return merged
