#!/bin/sh
# Prints the first Python that works here and is one of VERSIONS: the commands given, then
# python3.x on PATH and in pyenv's folder. Usage: setup/find-python.sh "3.12 3.11" [COMMAND...]
versions=$1
shift

for version in $versions; do
    set -- "$@" "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python
done
for python; do
    # A command on PATH may still fail: pyenv has shims for versions that are not enabled.
    is=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
    case " $versions " in *" ${is:-none} "*)
        echo "$python"
        exit 0
        ;;
    esac
done
exit 1
