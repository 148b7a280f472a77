#!/bin/sh
# Installs the method alone with the oldest versions of what it needs, no ROS; the test tools are
# those of the lock. Usage: setup/oldest.sh VENV
set -eux
pip() { "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"; }
venv=$1
pinned=$venv/lock.txt
grep -ivE '^(numpy|opencv-python-headless|pyyaml|scipy)==' requirements/lock.txt >"$pinned"
pip install -c "$pinned" setuptools hatchling pytest pytest-timeout hypothesis
pip install -c "$pinned" -r requirements/oldest.txt --no-build-isolation --editable .
pip check
"$venv/bin/python" -c 'import mrs_people_loc'
