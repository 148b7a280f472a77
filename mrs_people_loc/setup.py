"""For colcon only; pip installs from the repository's pyproject.toml."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name="mrs_people_loc",
    version="0.1.0",
    packages=find_packages(),
    package_data={"mrs_people_loc": ["*.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/mrs_people_loc"]),
        ("share/mrs_people_loc", ["package.xml"]),
        ("share/mrs_people_loc/config", glob("../config/*.yaml") + glob("../config/*.rviz")),
        ("share/mrs_people_loc/config/fastdds", glob("../config/fastdds/*.xml")),
        ("share/mrs_people_loc/config/sros2", glob("../config/sros2/*.xml")),
        # What `mrs demo`, `bench`, `experiment` and `suite` take unless they are told otherwise.
        ("share/mrs_people_loc/scenes", glob("../scenes/*")),
        ("share/mrs_people_loc/bags", glob("../bags/*.yaml")),
        *((f"share/mrs_people_loc/{bag[3:-1]}", glob(f"{bag}*")) for bag in glob("../bags/*/")),
    ],
    entry_points={"console_scripts": ["mrs = mrs_tools.cli:main"]},
    license="Apache-2.0",
    zip_safe=True,
)
