"""TF's packages for the tests: those that are installed, or what can be had without them.

`tf2_msgs` is built from a copy of its one definition, with the tools that build our own messages:
the type on the wire is the real one. `tf2_ros` has a part in C++ whose sources are not at hand; in
its place there is `stand_in/tf2_ros`, for the tests only.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros.harness import ROOT

STAND_IN = Path(__file__).with_name("stand_in")

_CMAKE = """\
cmake_minimum_required(VERSION 3.22)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
"""
_PACKAGE = """\
<package format="3">
  <name>tf2_msgs</name><version>0.36.0</version><description>For the tests</description>
  <maintainer email="maintainers@example.org">The mrs-people-loc maintainers</maintainer>
  <license>BSD</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


@contextlib.contextmanager
def tf2(folder: Path) -> Iterator[None]:
    """Both packages can be imported, here and in processes that are started, while it lasts.

    Args:
        folder: Where to build what is not installed.
    """
    with pytest.MonkeyPatch.context() as patch:

        def add(variable: str, path: Path) -> None:
            rest = os.environ.get(variable)
            patch.setenv(variable, f"{path}{os.pathsep}{rest}" if rest else str(path))

        if importlib.util.find_spec("tf2_msgs") is None:
            _build(folder)
            version = f"python{sys.version_info.major}.{sys.version_info.minor}"
            packages = folder / "prefix" / "lib" / version / "site-packages"
            add("AMENT_PREFIX_PATH", folder / "prefix")
            add("LD_LIBRARY_PATH", folder / "prefix" / "lib")
            add("PYTHONPATH", packages)
            patch.syspath_prepend(str(packages))
            # This process looks at LD_LIBRARY_PATH no more; what is loaded is found by its name.
            for library in (folder / "prefix" / "lib").glob("*.so"):
                ctypes.CDLL(str(library))
        if importlib.util.find_spec("tf2_ros") is None:
            add("PYTHONPATH", STAND_IN)
        yield


def _build(folder: Path) -> None:
    """Builds tf2_msgs as setup/messages.sh builds our own messages."""
    source, build, prefix = folder / "source", folder / "build", folder / "prefix"
    (source / "msg").mkdir(parents=True)
    (source / "CMakeLists.txt").write_text(_CMAKE)
    (source / "package.xml").write_text(_PACKAGE)
    (source / "msg" / "TFMessage.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": sys.prefix,
        "PATH": f"{sys.prefix}/bin:{os.environ['PATH']}",
    }
    configure = [
        "cmake", "-S", source, "-B", build, "-G", "Ninja",
        "-DCMAKE_BUILD_TYPE=None",
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        f"-DCMAKE_INSTALL_RPATH={prefix}/lib",
        f"-DCMAKE_PREFIX_PATH={sys.prefix}",
        f"-DCMAKE_PROJECT_INCLUDE={ROOT}/setup/wheels.cmake",
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
