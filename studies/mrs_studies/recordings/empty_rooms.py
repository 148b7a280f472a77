"""Public pictures with depth of rooms in which nobody is.

All were looked at: nobody is in them, and the floor that is found in them is the floor. Rooms are
for fitting and untouched in turn, in the order in which they stand here; the four views of the hall
of TUM's data sets stand so that they are in one half.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from mrs_people_loc.errors import FloorError
from mrs_studies.recordings.depth_views import DepthCamera, StereoView, stereo_view
from mrs_studies.recordings.sources import Source


class Half(str, Enum):
    """What the rooms of a half are for, in turn."""

    FITTING = "fitting"
    UNTOUCHED = "untouched"


HALVES = tuple(half.value for half in Half)


@dataclass(frozen=True)
class Room:
    """A room of which there are pictures with depth.

    Attributes:
        name: Its name.
        data_set: What its pictures are of.
        source: Where they are.
        camera: What they were taken with.
        colour: File of a picture within the source, `{}` for its number.
        depth: File of its depth, likewise.
        numbers: The pictures that are used: up to 8, spread over those that show the floor.
    """

    name: str
    data_set: str
    source: Source
    camera: DepthCamera
    colour: str
    depth: str
    numbers: tuple[str, ...] = ("",)

    @property
    def half(self) -> str:
        """One of `HALVES`."""
        return HALVES[ROOMS.index(self) % 2]

    def pictures(self, folder: Path) -> list[tuple[str, Path, Path]]:
        """Name, picture and depth of each view.

        Args:
            folder: Holds the checkouts of all sources.

        Raises:
            BagError: That of this room is missing.
        """
        checkout = self.source.within(folder)
        return [
            (
                f"{self.name} {number}".strip(),
                checkout / self.colour.format(number),
                checkout / self.depth.format(number),
            )
            for number in self.numbers
        ]

    def views(self, folder: Path) -> Iterator[tuple[str, StereoView | FloorError]]:
        """Name of each view, and what a head sees there, or why it cannot be used.

        Args:
            folder: Holds the checkouts of all sources.

        Raises:
            BagError: That of this room is missing, or a picture cannot be read.
        """
        for name, colour, depth in self.pictures(folder):
            try:
                yield name, stereo_view(*self.camera.read(colour, depth), self.camera)
            except FloorError as err:
                yield name, err


def _numbers(first: int, last: int, step: int, digits: int = 1) -> tuple[str, ...]:
    return tuple(f"{number:0{digits}}" for number in range(first, last + 1, step))


KITCHEN = Source(
    "andyzeng/tsdf-fusion-python", "3f22a940d90f684145b1f29b1feaa92e09eb1db6",
    "BSD; 7-Scenes: not for commercial use", "7-Scenes, red kitchen",
)  # fmt: skip
FREIBURG_1 = Source(
    "fy2462/slam-learning", "d7d234616bb199f68afc08ac9f83a4dea00a0218",
    "none stated; TUM RGB-D: CC BY 4.0", "TUM RGB-D, fr1",
)  # fmt: skip
FREIBURG_2 = Source(
    "cggos/rgbdslam_cg", "1cfd81ba649d5aa0d39f3e52e97245527b245142",
    "none stated; TUM RGB-D: CC BY 4.0", "TUM RGB-D, fr2 desk",
)  # fmt: skip
TRIPOD = Source(
    "suho0515/RGBD-tutorial", "5a55c6d3aa6dbead36042739f09866b0ac29aa35",
    "none stated", "a hall, as of TUM RGB-D, fr2",
)  # fmt: skip
CABINET = Source(
    "benchun123/cuboid_slam_with_bbox_constraints", "d228cfa2cd2bae42d568ee573165999977cc5e61",
    "none stated; TUM RGB-D: CC BY 4.0", "TUM RGB-D, fr3 cabinet",
)  # fmt: skip
OPEN3D = Source(
    "mikiec84/Open3D", "879b6fc55110504f64c06cf5172da1df6f94a0e8",
    "MIT", "examples of Redwood, SUN RGB-D and TUM RGB-D",
)  # fmt: skip
HOME = Source(
    "gaoxiang12/slambook", "853abac78495533dfbe3e4e8d4619017111d5842",
    "MIT (the code)", "a home",
)  # fmt: skip
NYU = Source(
    "s-gupta/rcnn-depth", "7a7baf7dcccc6fdf6be7c13d16828064d89dff4e",
    "BSD", "NYU Depth V2",
)  # fmt: skip
SUN = Source(
    "GuardianWang/sunrgbd-toy", "feca6a0f7ba3ba6d5d2cb6b85992f4e440e6b7f4",
    "none stated", "two pictures of SUN RGB-D",
)  # fmt: skip

_TUM_M = 1 / 5000
_OPEN3D = "examples/TestData/RGBD"
_SUN_IMAGES = "images/2014-12-18_11-31-54_260595134347", "images/img_0063"

#: In turn for fitting and untouched.
ROOMS = (
    Room(
        "red kitchen", "7-Scenes", KITCHEN, DepthCamera(585, 585, 320, 240),
        "data/frame-{}.color.jpg", "data/frame-{}.depth.png",
        (*_numbers(0, 120, 40, 6), *_numbers(680, 800, 40, 6)),
    ),
    Room(
        "desk in a hall", "TUM RGB-D", FREIBURG_2,
        DepthCamera(520.9, 521.0, 325.1, 249.7, _TUM_M),
        "data/rgb{}.png", "data/depth{}.png", ("1", "2"),
    ),
    Room(
        "living room", "slambook", HOME, DepthCamera(518, 519, 325.5, 253.5),
        "ch5/joinMap/color/{}.png", "ch5/joinMap/depth/{}.pgm", _numbers(1, 5, 1),
    ),
    Room(
        "hall with a tripod", "TUM RGB-D", TRIPOD,
        DepthCamera(520.9, 521.0, 325.1, 249.7, _TUM_M),
        "data/rgb/{}.png", "data/depth/{}.png", _numbers(1, 50, 7),
    ),
    Room(
        "corridor", "SUN RGB-D", OPEN3D, DepthCamera(570.34, 570.34, 320, 240, rotated=True),
        f"{_OPEN3D}/other_formats/SUN_color.jpg", f"{_OPEN3D}/other_formats/SUN_depth.png",
    ),
    Room(
        "cabinet in a hall", "TUM RGB-D", CABINET,
        DepthCamera(535.4, 539.2, 320.1, 247.6, _TUM_M),
        "data/raw_imgs/{}_rgb_raw.jpg", "data/depth_imgs/{}_depth_raw.png",
        _numbers(0, 56, 8, 4),
    ),
    Room(
        "rocking chair", "Redwood", OPEN3D, DepthCamera(525, 525, 319.5, 239.5),
        f"{_OPEN3D}/color/{{}}.jpg", f"{_OPEN3D}/depth/{{}}.png", _numbers(0, 4, 1, 5),
    ),
    Room(
        "office in a hall", "TUM RGB-D", OPEN3D, DepthCamera(535.4, 539.2, 320.1, 247.6, _TUM_M),
        f"{_OPEN3D}/other_formats/TUM_color.png", f"{_OPEN3D}/other_formats/TUM_depth.png",
    ),
    Room(
        "office", "TUM RGB-D", FREIBURG_1, DepthCamera(517.3, 516.5, 318.6, 255.3, _TUM_M),
        "data/rgb/1305031453.491698.png", "data/depth/1305031453.505218.png",
    ),
    Room(
        "dining room", "NYU Depth V2", NYU, DepthCamera(518.86, 519.47, 284.58, 208.74),
        "demo-data/images.png", "demo-data/rawdepth.png",
    ),
    Room(
        "shelves and a chair", "SUN RGB-D", SUN,
        DepthCamera(520.53, 520.74, 277.93, 215.12, rotated=True),
        f"{_SUN_IMAGES[1]}/image/img_0063.jpg", f"{_SUN_IMAGES[1]}/depth_bfx/img_0063_abs.png",
    ),
    Room(
        "office with chairs", "SUN RGB-D", SUN, DepthCamera(529.5, 529.5, 365, 265, rotated=True),
        f"{_SUN_IMAGES[0]}/image/0000144.jpg", f"{_SUN_IMAGES[0]}/depth_bfx/0000144.png",
    ),
)  # fmt: skip
