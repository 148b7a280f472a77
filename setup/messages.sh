#!/bin/sh
# Builds msgs/ (package mrs_people_msgs) and installs it into the virtual environment, where
# nothing needs to be sourced. Usage: setup/messages.sh VENV
set -eux
venv=$(readlink -f "$1")
build=$venv/messages # hidden from colcon, as .venv is
export AMENT_PREFIX_PATH="$venv" PATH="$venv/bin:$PATH"
rm -rf "$build"
cmake -S msgs -B "$build" -G Ninja \
    -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_INSTALL_PREFIX="$venv" \
    -DCMAKE_PREFIX_PATH="$venv" \
    -DCMAKE_PROJECT_INCLUDE="$PWD/setup/wheels.cmake" \
    -DPython3_EXECUTABLE="$venv/bin/python"
cmake --build "$build"
cmake --install "$build"
cd "$venv" # away from the source folders
python -c 'import mrs_people_msgs.action as a, mrs_people_msgs.msg as m; a.GuideTour.Goal(); m.People(); m.Person(); m.Group(); m.RobotScan(); m.TeamPose(); m.Wall(); m.RelativePoses()'
