#!/bin/sh
# Makes the virtual environment, unless it stands already.
# Usage: setup/venv.sh VENV PYTHON [asked]
#   asked: PYTHON was asked for, so an environment of another version will not do.
set -eu
venv=$1
python=$2
asked=${3:-}
version='import sys; print("%d.%d" % sys.version_info[:2])'

# A virtual environment holds its own path: one that was moved is of no use.
if [ "$(cat "$venv/.made" 2>/dev/null)" = "$PWD/$venv" ] && has=$("$venv/bin/python" -c "$version")
then
    [ -z "$asked" ] && exit 0
    [ "$has" = "$("$python" -c "$version")" ] && exit 0
    echo "$venv is of Python $has, $python is another: making it anew."
fi
"$(dirname "$0")/check.sh" "$python"
"$(dirname "$0")/step.sh" "$venv.log" "Making $venv with $("$python" --version)" \
    "$python" -m venv --clear "$venv"
rm "$venv.log"
echo "$PWD/$venv" >"$venv/.made"
