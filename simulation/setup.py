"""For colcon; pip goes by `pyproject.toml`. What a robot installs has none of it."""

from setuptools import find_packages, setup

setup(
    name="mrs_people_sim",
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/mrs_people_sim"]),
        ("share/mrs_people_sim", ["package.xml"]),
    ],
    license="Apache-2.0",
    zip_safe=True,
)
