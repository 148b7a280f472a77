#!/bin/sh
# Names everything that the set-up needs and this machine lacks, with the command that installs it.
# Usage: setup/check.sh PYTHON "SUPPORTED VERSIONS"
python=$1
versions=$2
lacking=
packages=

lacks() { # WHAT [Debian package...]
    lacking="$lacking
  - $1"
    shift
    packages="$packages $*"
}

ask() { "$python" -c "$1" 2>/dev/null; }

machine=$(uname -sm)
[ "$machine" = "Linux x86_64" ] ||
    lacks "Linux on x86-64 (this is $machine): the ROS wheels exist for no other platform.
    With ROS 2 Jazzy from packages, build with colcon instead; see docs/install.md."

is=$(ask 'import sys; print("%d.%d" % sys.version_info[:2])')
case " $versions " in
*" ${is:-none} "*)
    # Debian and Ubuntu split Python into several packages.
    ask 'import venv, ensurepip' || lacks "venv for Python $is" "python$is-venv"
    ask 'import os, sysconfig as s; os.stat(s.get_path("include") + "/Python.h")' ||
        lacks "Python.h of Python $is, to build the messages" "python$is-dev"
    ;;
*)
    what="Python, one of $versions ('$python' is ${is:-none that works})"
    if other=$("$(dirname "$0")/find-python.sh" "$versions" python3); then
        lacks "$what; a suitable one is installed: PYTHON=$other"
    elif [ -z "$is" ]; then
        lacks "$what" python3 python3-venv python3-dev
    else
        for version in $versions; do
            apt-cache show "python$version" >/dev/null 2>&1 && break
            version=
        done
        if [ -n "$version" ]; then
            lacks "$what" "python$version" "python$version-venv" "python$version-dev"
        else
            lacks "$what; apt has none here; pyenv, for example, has: pyenv install 3.12"
        fi
    fi
    ;;
esac

command -v "${CC:-cc}" >/dev/null && command -v "${CXX:-c++}" >/dev/null ||
    lacks "a C++ compiler, to build the messages" g++
command -v make >/dev/null || lacks "make" make

[ -z "$lacking" ] && exit 0
echo "This machine lacks:$lacking"
packages=$(echo $packages) # one space between, none around
[ -z "$packages" ] || echo "On Debian and Ubuntu:  sudo apt-get install $packages"
exit 1
