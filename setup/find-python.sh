#!/bin/sh
# Prints the first of the given Python versions that works here. Usage: setup/find-python.sh 3.12 ...
for version; do
    for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
        # Being on PATH is not enough: pyenv's shims are, for versions that are switched off.
        if "$python" -c "import sys; assert '%d.%d' % sys.version_info[:2] == '$version'" 2>/dev/null
        then
            echo "$python"
            exit 0
        fi
    done
done
exit 1
