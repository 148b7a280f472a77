"""For colcon only; pip installs from the repository's pyproject.toml."""

import re
from glob import glob
from os.path import isfile
from pathlib import Path

from setuptools import find_packages, setup

#: Those of the repository; users may keep bags of their own beside them.
BAGS = re.findall(r"^(\w+):$", Path("bags/manifest.yaml").read_text(), re.MULTILINE)


def files(pattern: str) -> list[str]:
    return list(filter(isfile, glob(pattern)))


setup(
    name="mrs_people_loc",
    version="0.1.0",
    packages=find_packages(),
    package_data={
        "mrs_people_loc.bodies": ["*.json", "*.npy", "*.onnx"],
        "mrs_tools.view": ["page/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/mrs_people_loc"]),
        ("share/mrs_people_loc", ["package.xml", "LICENSE", "NOTICE"]),
        ("share/mrs_people_loc/config", files("config/*")),
        ("share/mrs_people_loc/config/fastdds", glob("config/fastdds/*.xml")),
        ("share/mrs_people_loc/config/nav2", glob("config/nav2/*")),
        ("share/mrs_people_loc/config/sros2", glob("config/sros2/*.xml")),
        # What `mrs demo`, `bench`, `experiment` and `suite` take unless they are told otherwise.
        ("share/mrs_people_loc/scenes", glob("scenes/*")),
        ("share/mrs_people_loc/bags", ["bags/manifest.yaml", "bags/walking_group.yaml"]),
        *((f"share/mrs_people_loc/bags/{bag}", files(f"bags/{bag}/*")) for bag in BAGS),
    ],
    entry_points={"console_scripts": ["mrs = mrs_tools.cli:main"]},
    license="Apache-2.0",
    zip_safe=True,
)
