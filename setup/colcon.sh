#!/bin/sh
# Builds all packages with colcon on the ROS wheels of the virtual environment.
# (With ROS from Ubuntu's packages a plain `colcon build` does.)
# Usage: setup/colcon.sh VENV FOLDER [OPTION of colcon build...]
set -eu
venv=$(readlink -f "$1")
folder=$2
shift 2
export AMENT_PREFIX_PATH="$venv" PATH="$venv/bin:$PATH"
exec colcon --log-base "$folder/log" build \
    --build-base "$folder/build" --install-base "$folder/install" "$@" \
    --cmake-args -G Ninja \
    -DCMAKE_PREFIX_PATH="$venv" \
    -DCMAKE_PROJECT_INCLUDE="$PWD/setup/wheels.cmake" \
    -DPython3_EXECUTABLE="$venv/bin/python"
