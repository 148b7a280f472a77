#!/bin/sh
# Installs the core with the oldest supported versions of its dependencies, and no ROS. The other
# requirements of the tests (pytest; the `mrs` command, which reads recordings) are those of the lock.
# Usage: setup/oldest.sh VENV
set -eux
venv=$1
pip() { "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"; }

others=$venv/lock.txt
grep -ivE '^(numpy|opencv-python-headless|pyyaml|scipy)==' requirements/lock.txt >"$others"
pip install -c "$others" setuptools hatchling pytest pytest-timeout hypothesis
pip install -c "$others" -c requirements/oldest.txt --no-build-isolation -e '.[tools,convert]'
pip check # our lower bounds accept these versions
