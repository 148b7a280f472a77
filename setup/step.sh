#!/bin/sh
# Runs one long step of the set-up: prints its description and duration; its output goes to a log,
# whose end is shown if it fails. Usage: setup/step.sh LOG "Description" COMMAND [ARGUMENT...]
log=$1
what=$2
shift 2
mkdir -p "$(dirname "$log")"
printf '%s ... ' "$what"
start=$(date +%s)
if "$@" >"$log" 2>&1 </dev/null; then
    echo "$(($(date +%s) - start)) s"
else
    echo "FAILED. The end of $log:"
    tail -n 40 "$log"
    exit 1
fi
