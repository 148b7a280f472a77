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
    ],
    entry_points={"console_scripts": ["mrs = mrs_tools.cli:main"]},
    license="Apache-2.0",
    zip_safe=True,
)
