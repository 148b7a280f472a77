"""For colcon only; pip installs from the repository's pyproject.toml."""

from setuptools import find_packages, setup

setup(
    name="mrs_people_loc",
    version="0.1.0",
    packages=find_packages(),
    package_data={
        "": ["py.typed"],
        "mrs_people_loc.bodies": ["*.json", "*.onnx"],
        "mrs_tools.view": ["page/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/mrs_people_loc"]),
        ("share/mrs_people_loc", ["package.xml", "LICENSE", "NOTICE"]),
    ],
    entry_points={"console_scripts": ["mrs = mrs_tools.cli:main"]},
    license="Apache-2.0",
    zip_safe=True,
)
