#!/bin/sh
# Creates the virtual environment, unless it exists already.
# Usage: setup/venv.sh VENV "SUPPORTED VERSIONS" [PYTHON]
# Without PYTHON an existing environment is kept, and a new one gets the first suitable Python.
set -eu
venv=$1
versions=$2
python=${3:-}
here=$(dirname "$0")
version() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null; }

# An environment contains its own path: one that was moved, or whose Python is gone, is unusable.
if [ "$(cat "$venv/.made" 2>/dev/null)" = "$PWD/$venv" ] && is=$(version "$venv/bin/python"); then
    [ -n "$python" ] && [ "$(version "$python")" != "$is" ] || exit 0
    echo "$venv has Python $is; creating it again with $python."
fi

[ -n "$python" ] || python=$("$here/find-python.sh" "$versions" python3) || python=python3
"$here/check.sh" "$python" "$versions"
"$here/step.sh" "$venv.log" "Creating $venv with $("$python" --version)" \
    "$python" -m venv --clear "$venv"
rm "$venv.log"
echo "$PWD/$venv" >"$venv/.made"
