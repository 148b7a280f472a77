"""For colcon only; pip installs from the repository's pyproject.toml."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name="planner_node",
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/planner_node"]),
        ("share/planner_node", ["package.xml"]),
        ("share/planner_node/launch", glob("launch/*.launch.py")),
    ],
    entry_points={
        "console_scripts": [
            "planner_node = planner_node.__main__:main",
            "guide_node = planner_node.guide_node.__main__:main",
        ]
    },
    license="Apache-2.0",
    zip_safe=True,
)
