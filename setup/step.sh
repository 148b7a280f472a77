#!/bin/sh
# Runs one long step of the set-up: says what and how long it took; what it prints goes to a log,
# which is shown if it fails. Usage: setup/step.sh LOG "What it does" COMMAND [ARGUMENT...]
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
