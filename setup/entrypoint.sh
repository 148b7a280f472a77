#!/bin/bash
# The entrypoint of the image (Dockerfile): runs a command with the workspace.
set -e
. /opt/mrs/setup.bash
exec "$@"
