"""Packages of messages for the tests: those that are installed, or built here.

They are built by the tools that build our own messages, only as far as Python on Fast DDS needs
them. The definitions are the fields of the packages' messages; `test_others` holds their hashes
against those of the packages' own files. `MRS_INTERFACES=DIR` builds from the files themselves,
`DIR/<package>/msg/*.msg`.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros.harness import ROOT

#: By package and message, its fields.
DEFINITIONS = {
    "tf2_msgs": {"TFMessage": ["geometry_msgs/TransformStamped[] transforms"]},
    "people_msgs": {
        "People": ["std_msgs/Header header", "Person[] people"],
        "Person": [
            "string name",
            "geometry_msgs/Point position",
            "geometry_msgs/Point velocity",
            "float64 reliability",
            "string[] tagnames",
            "string[] tags",
        ],
    },
    "hri_msgs": {
        "IdsList": ["std_msgs/Header header", "string[] ids"],
        "Group": ["std_msgs/Header header", "string group_id", "string[] members"],
    },
    "vision_msgs": {
        "Detection3DArray": ["std_msgs/Header header", "Detection3D[] detections"],
        "Detection3D": [
            "std_msgs/Header header",
            "ObjectHypothesisWithPose[] results",
            "BoundingBox3D bbox",
            "string id",
        ],
        "ObjectHypothesisWithPose": [
            "ObjectHypothesis hypothesis",
            "geometry_msgs/PoseWithCovariance pose",
        ],
        "ObjectHypothesis": ["string class_id", "float64 score"],
        "BoundingBox3D": ["geometry_msgs/Pose center", "geometry_msgs/Vector3 size"],
    },
}

#: Found out once: what was built here and imported is found later on, too.
INSTALLED = {name for name in DEFINITIONS if importlib.util.find_spec(name) is not None}

# Without C++, which takes half of the time.
_CMAKE = """\
cmake_minimum_required(VERSION 3.22)
project({package})
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(std_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
rosidl_generate_interfaces({package} {files} DEPENDENCIES geometry_msgs std_msgs)
ament_package()
"""
_PACKAGE = """\
<package format="3">
  <name>{package}</name><version>0.0.0</version><description>For the tests</description>
  <maintainer email="maintainers@example.org">The mrs-people-loc maintainers</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <depend>std_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


@contextlib.contextmanager
def interfaces(factory: pytest.TempPathFactory, *packages: str) -> Iterator[None]:
    """Packages can be imported, here and in processes that are started, while it lasts."""
    missing = tuple(name for name in packages if name not in INSTALLED)
    with pytest.MonkeyPatch.context() as patch:
        if missing:
            prefix = built(factory, missing)
            version = f"python{sys.version_info.major}.{sys.version_info.minor}"
            python = prefix / "lib" / version / "site-packages"
            add(patch, "AMENT_PREFIX_PATH", prefix)
            add(patch, "LD_LIBRARY_PATH", prefix / "lib")
            add(patch, "PYTHONPATH", python)
            patch.syspath_prepend(str(python))
            # This process looks at LD_LIBRARY_PATH no more; what is loaded is found by its name.
            for library in (prefix / "lib").glob("*.so"):
                ctypes.CDLL(str(library))
        yield


def add(patch: pytest.MonkeyPatch, variable: str, path: Path) -> None:
    """Puts a path at the beginning of a variable of the environment."""
    rest = os.environ.get(variable)
    patch.setenv(variable, f"{path}{os.pathsep}{rest}" if rest else str(path))


def built(factory: pytest.TempPathFactory, packages: tuple[str, ...]) -> Path:
    """Prefix of packages, which are built once for all workers."""
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder = shared / "-".join(("interfaces", *packages))
    with Path(f"{folder}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            _build(folder, packages)
    return folder / "prefix"


def _build(folder: Path, packages: tuple[str, ...]) -> None:
    """Builds packages as setup/messages.sh builds our own."""
    for package in packages:
        _write(folder / "source" / package, package)
    (folder / "source" / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.22)\nproject(all_interfaces)\n"
        + "".join(f"add_subdirectory({package})\n" for package in packages)
    )
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": sys.prefix,
        "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}",
    }
    prefix, build = folder / "prefix", folder / "build"
    configure = [
        "cmake", "-S", folder / "source", "-B", build, "-G", "Ninja",
        "-DCMAKE_BUILD_TYPE=None",
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        f"-DCMAKE_INSTALL_RPATH={prefix}/lib",
        f"-DCMAKE_PREFIX_PATH={sys.prefix}",
        f"-DCMAKE_PROJECT_INCLUDE={ROOT}/setup/messages.cmake",
        f"-DPython3_EXECUTABLE={sys.executable}",
    ]  # fmt: skip
    for command in (configure, ["cmake", "--build", build], ["cmake", "--install", build]):
        done = subprocess.run(
            list(map(str, command)),
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout


def _write(folder: Path, package: str) -> None:
    """Writes the sources of a package."""
    (folder / "msg").mkdir(parents=True)
    messages = DEFINITIONS[package]
    for name, fields in messages.items():
        text = "\n".join(fields) + "\n"
        if given := os.environ.get("MRS_INTERFACES"):
            text = Path(given, package, "msg", f"{name}.msg").read_text(encoding="utf-8")
        (folder / "msg" / f"{name}.msg").write_text(text, encoding="utf-8")
    files = " ".join(f"msg/{name}.msg" for name in messages)
    (folder / "CMakeLists.txt").write_text(_CMAKE.format(package=package, files=files))
    (folder / "package.xml").write_text(_PACKAGE.format(package=package))
