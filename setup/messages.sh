#!/bin/sh
# Builds msgs/ (package mrs_people_msgs), and tf2_msgs/TFMessage, which is no wheel, and installs them
# into the virtual environment, where nothing needs to be sourced. Usage: setup/messages.sh VENV
set -eux
venv=$(readlink -f "$1")
build=$venv/messages # hidden from colcon, as .venv is
tf=$build/tf2_msgs
made=$venv/share/mrs_people_msgs/made_of

# What was built from the same definitions, by the same tools, stays.
of=$({
    cat msgs/*.* msgs/action/* msgs/msg/* setup/messages.* setup/wheels.cmake
    grep ^ros-jazzy requirements/lock.txt
    "$venv/bin/python" --version
} | sha256sum)
[ "$(cat "$made" 2>/dev/null)" != "$of" ] || exit 0

export AMENT_PREFIX_PATH="$venv" PATH="$venv/bin:$PATH"
rm -rf "$build" "$made"

mkdir -p "$tf/msg"
echo 'geometry_msgs/TransformStamped[] transforms' >"$tf/msg/TFMessage.msg"
sed -e 's/mrs_people_msgs/tf2_msgs/' -e '/<license/s/ file="LICENSE"//' msgs/package.xml >"$tf/package.xml"
cat >"$tf/CMakeLists.txt" <<END
project(tf2_msgs)
find_package(geometry_msgs REQUIRED)
rosidl_generate_interfaces(tf2_msgs msg/TFMessage.msg DEPENDENCIES geometry_msgs)
ament_package()
END
cat >"$build/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.22)
project(messages)
add_subdirectory("$PWD/msgs" mrs_people_msgs)
add_subdirectory(tf2_msgs)
END
cmake -S "$build" -B "$build/build" -G Ninja \
    -DCMAKE_BUILD_TYPE=None \
    -DCMAKE_INSTALL_PREFIX="$venv" \
    -DCMAKE_PREFIX_PATH="$venv" \
    -DCMAKE_PROJECT_INCLUDE="$PWD/setup/messages.cmake" \
    -DPython3_EXECUTABLE="$venv/bin/python"
cmake --build "$build/build"
cmake --install "$build/build"
cd "$venv" # away from the source folders
python -c 'import mrs_people_msgs.action as a, mrs_people_msgs.msg as m, tf2_msgs.msg as t; a.GuideTour.Goal(); m.People(); m.Person(); m.Group(); m.RobotScan(); m.TeamPose(); m.Wall(); m.RelativePoses(); t.TFMessage()'
rm -rf "$build"
echo "$of" >"$made"
