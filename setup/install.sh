#!/bin/sh
# Installs the wheels of requirements/lock.txt that every target needs, and those of GROUPS.
# Usage: setup/install.sh VENV [GROUP...]
set -eu
venv=$1
shift
lock=$venv/lock.txt
pip() { "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"; }

# A second # begins the groups of a line.
awk -v groups="$*" 'BEGIN { split(groups, all); for (i in all) wanted[all[i]] }
    { n = split($0, part, "#"); keep = n < 2; split(part[2], of, " ")
      for (i in of) if (of[i] in wanted) keep = 1 }
    keep' requirements/lock.txt >"$lock"

# What is built from its source needs setuptools first. uv takes a tenth of pip's time; pip does
# what it cannot, such as use the index of pip's own configuration.
[ -x "$venv/bin/uv" ] || pip install --no-compile --constraint "$lock" uv setuptools hatchling
options="--no-deps --no-build-isolation --requirement $lock"
# shellcheck disable=SC2086
"$venv/bin/uv" pip install --python "$venv/bin/python" $options || pip install $options

# Now, since the processes of a team, which start together, would each do so. Some files that are no
# modules fail.
"$venv/bin/python" -m compileall -q -j 0 -x '/tests/' "$venv"/lib/python3.*/site-packages || true
