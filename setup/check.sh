#!/bin/sh
# Names everything that `make setup` needs and this machine lacks, with the command that installs
# it. Usage: setup/check.sh PYTHON
set -u
python=$1
problems=
packages=

lacks() { # what [Debian package...]
    problems="$problems
  - $1"
    shift
    packages="$packages $*"
}

ask() { "$python" -c "$1" 2>/dev/null; }

machine=$(uname -sm)
[ "$machine" = "Linux x86_64" ] ||
    lacks "Linux on x86-64 (this is $machine): the ROS wheels are made for nothing else. With ROS 2
    Jazzy installed from packages, build with colcon instead (see README.md)."

version=$(ask 'import sys; print("%d.%d" % sys.version_info[:2])')
case $version in
3.10 | 3.11 | 3.12 | 3.13)
    # Debian's and Ubuntu's own Python comes in parts.
    ask 'import venv, ensurepip' || lacks "venv of Python $version" "python$version-venv"
    ask 'import os, sysconfig as s; assert os.path.exists(s.get_path("include") + "/Python.h")' ||
        lacks "Python.h of Python $version (to build the messages)" "python$version-dev"
    ;;
*)
    if [ -z "$version" ]; then
        problem="a working Python ('$python' is none)"
    else
        problem="Python 3.10, 3.11, 3.12 or 3.13 ('$python' is $version)"
    fi
    other=$("$(dirname "$0")/find-python.sh" 3.12 3.11 3.13 3.10)
    if [ -n "$other" ]; then
        lacks "$problem; there is another one: make setup PYTHON=$other"
    elif [ -z "$version" ]; then
        lacks "$problem" python3 python3-venv python3-dev
    else
        lacks "$problem; install one and name it: make setup PYTHON=python3.12" \
            python3.12 python3.12-venv python3.12-dev
    fi
    ;;
esac

command -v "${CC:-cc}" >/dev/null && command -v "${CXX:-c++}" >/dev/null ||
    lacks "a C++ compiler (to build the messages)" g++
command -v make >/dev/null || lacks "make" make

[ -z "$problems" ] && exit 0
echo "This machine lacks:$problems" >&2
if [ -n "${packages# }" ]; then
    # shellcheck disable=SC2086  # one word for each package
    echo "Debian and Ubuntu:  sudo apt-get install" $packages >&2
fi
exit 1
