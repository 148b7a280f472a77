"""What the core's tests share: cells, camera_info messages, and stereo heads that draw images.

All of it is handed out by fixtures of session scope, so that Hypothesis' tests can use it, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from mrs_people_loc.config import Mounting, RobotConfig, load_team
from mrs_people_loc.scan import Cells
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera
from mrs_people_loc.sensing.images import StereoImages

PAPER = Path(__file__).resolve().parents[2] / "config" / "paper.yaml"


def _cells(xy, *, z=1.3, z_min=0.3, top=1.7, count=100) -> Cells:
    """Cells at (x, y); every other field may be one number or one per cell."""
    xy = np.asarray(xy, dtype=np.float32).reshape(-1, 2)
    n = len(xy)
    return Cells(
        x=xy[:, 0].copy(),
        y=xy[:, 1].copy(),
        z=np.full(n, z, dtype=np.float32),
        z_min=np.full(n, z_min, dtype=np.float32),
        top=np.full(n, top, dtype=np.float32),
        count=np.full(n, count, dtype=np.uint32),
    )


def _camera_info(**changes) -> SimpleNamespace:
    """A CameraInfo as rclpy's and rosbags' classes have it: 160 x 120, f = 100 px."""
    values = {
        "width": 160,
        "height": 120,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [100.0, 0.0, 79.5, 0.0, 100.0, 59.5, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [100.0, 0.0, 79.5, 0.0, 0.0, 100.0, 59.5, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False),
    }
    assert changes.keys() <= values.keys()
    return SimpleNamespace(**values | changes)


@dataclass(frozen=True)
class Rectangle:
    """A textured rectangle in the robot's frame: corner + a * side_a + b * side_b, 0 <= a, b <= 1.

    The texture is random with grains of `grain` [m]; `grain_b` is that along side b.
    """

    corner: tuple[float, float, float]
    side_a: tuple[float, float, float]
    side_b: tuple[float, float, float]
    grain: float = 0.05
    grain_b: float | None = None
    seed: int = 0

    def hit(self, origin, rays):
        """How far along each ray it is hit (inf: not at all), and the grey value there."""
        corner, a, b = map(np.array, (self.corner, self.side_a, self.side_b))
        normal = np.cross(a, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (normal @ (corner - origin)) / (rays @ normal)
            at = origin + depth[:, None] * rays - corner
        part_a, part_b = at @ a / (a @ a), at @ b / (b @ b)
        on = (depth > 0) & (part_a >= 0) & (part_a <= 1) & (part_b >= 0) & (part_b <= 1)
        on &= np.isfinite(depth)
        grains_a = np.linalg.norm(a) / self.grain
        grains_b = np.linalg.norm(b) / (self.grain_b or self.grain)
        shape = (int(grains_b) + 2, int(grains_a) + 2)
        texture = np.random.default_rng(self.seed).uniform(20, 235, shape).astype(np.float32)
        u, v = np.where(on, part_a, 0) * grains_a, np.where(on, part_b, 0) * grains_b
        grey = [  # in strips, for cv2.remap takes images of up to 32767 rows
            cv2.remap(texture, s[:, :1].copy(), s[:, 1:].copy(), cv2.INTER_LINEAR).reshape(-1)
            for s in np.array_split(np.stack([u, v], axis=1).astype(np.float32), 8)
        ]
        return np.where(on, depth, np.inf), np.concatenate(grey)


@dataclass(frozen=True)
class Head:
    """A stereo head that draws what it sees by casting rays: the truth, without the core's help.

    Attributes:
        centres: Principal points (cx, cy) of the cameras [px].
        positions: Of the cameras in the left camera's optical frame (right, down) [m].
    """

    width: int = 160
    height: int = 120
    fx: float = 105.46
    fy: float = 105.46
    centres: dict = field(default_factory=dict)
    positions: dict = field(default_factory=dict)
    mounting: Mounting = field(default_factory=Mounting)

    def model(self, name: str) -> CameraModel:
        (cx, cy), (x, y) = self._of(name)
        p = [[self.fx, 0, cx, -self.fx * x], [0, self.fy, cy, -self.fy * y], [0, 0, 1, 0]]
        return CameraModel(
            self.width, self.height, np.array(p)[:, :3], (), np.eye(3), np.array(p, dtype=float)
        )

    def camera(self) -> StereoCamera:
        top = self.model("top") if "top" in self.positions else None
        return StereoCamera.from_models(self.model("left"), self.model("right"), top, self.mounting)

    def axes(self) -> np.ndarray:
        """Right, down and forward of the head in the robot's frame, as the rows."""
        m = self.mounting
        forward = np.array(
            [np.cos(m.pitch) * np.cos(m.yaw), np.cos(m.pitch) * np.sin(m.yaw), -np.sin(m.pitch)]
        )
        right = np.array([np.sin(m.yaw), -np.cos(m.yaw), 0.0])
        down = np.cross(forward, right)
        return np.stack(
            [
                np.cos(m.roll) * right + np.sin(m.roll) * down,
                np.cos(m.roll) * down - np.sin(m.roll) * right,
                forward,
            ]
        )

    def draw(self, *rectangles: Rectangle) -> tuple[StereoImages, np.ndarray]:
        """Images of all cameras, and the point that each pixel of `left` shows (NaN: none)."""
        names = ["left", "right", *(["top"] if "top" in self.positions else [])]
        shots = {name: self._shoot(name, rectangles) for name in names}
        images = StereoImages(0, **{name: grey for name, (grey, _) in shots.items()})
        return images, shots["left"][1]

    def disparity(self, *rectangles: Rectangle) -> np.ndarray:
        """What a perfect matcher gives: disparity of `left` [px], NaN where there is nothing."""
        _, points = self._shoot("left", rectangles)
        m = self.mounting
        depth = (points - (m.forward, m.left, m.height)) @ self.axes()[2]
        shift = self._of("left")[0][0] - self._of("right")[0][0]
        return (self.fx * self._of("right")[1][0] / depth + shift).astype(np.float32)

    def _shoot(self, name: str, rectangles: Sequence[Rectangle]) -> tuple[np.ndarray, np.ndarray]:
        (cx, cy), (x, y) = self._of(name)
        right, down, forward = self.axes()
        m = self.mounting
        origin = np.array([m.forward, m.left, m.height]) + x * right + y * down
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        a, b = (u.reshape(-1, 1) - cx) / self.fx, (v.reshape(-1, 1) - cy) / self.fy
        rays = a * right + b * down + forward
        depths, greys = zip(*(r.hit(origin, rays) for r in rectangles), strict=True)
        nearest = np.argmin(depths, axis=0), np.arange(len(rays))
        depth = np.array(depths)[nearest]
        seen = np.isfinite(depth)
        grey = np.where(seen, np.array(greys)[nearest], 128)
        points = origin + np.where(seen, depth, np.nan)[:, None] * rays
        size = (self.height, self.width)
        return np.rint(grey).astype(np.uint8).reshape(size), points.reshape(*size, 3)

    def _of(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        position = {"left": (0.0, 0.0), "right": (0.1, 0.0)} | self.positions
        return self.centres.get(name, middle), position[name]


def _paper(changes=None) -> RobotConfig:
    """A robot of config/paper.yaml, with changes by dotted name."""
    robot = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
    return RobotConfig.from_mapping(changes or {}, base=robot)


@pytest.fixture(scope="session")
def paper():
    return _paper


@pytest.fixture(scope="session")
def make_cells():
    return _cells


@pytest.fixture(scope="session")
def camera_info():
    return _camera_info


@pytest.fixture(scope="session")
def make_head():
    return Head


@pytest.fixture(scope="session")
def rectangle():
    return Rectangle
