"""`mrs discovery-server`: Fast DDS's own, with its libraries found."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from mrs_people_loc.errors import ConfigError
from mrs_ros.discovery import DISCOVERY_PORT
from mrs_tools.installing import how_to_install

_PROGRAM = "fast-discovery-server"


def command(
    port: Annotated[
        int, typer.Option("--port", min=1025, max=65535, help="UDP port to listen on.")
    ] = DISCOVERY_PORT,
) -> None:
    """Run a discovery server for a team on a network without multicast; Ctrl-C ends it.

    Give its address to all others: `mrs up --discovery-server`, the launch files'
    `discovery_server:=`, or ROS_DISCOVERY_SERVER. Nodes that have found each other go on without
    it.
    """
    beside = Path(sys.executable).parent  # where the wheels put it, and nobody need source anything
    folders = os.pathsep.join([str(beside), os.environ.get("PATH", os.defpath)])
    program = shutil.which(_PROGRAM, path=folders)
    if program is None:
        raise ConfigError(f"{_PROGRAM} is not installed: {how_to_install('rclpy')}")
    # Its libraries are found: with the wheels by LD_LIBRARY_PATH, which they set in every Python.
    os.execv(program, [_PROGRAM, "--server-id", "0", "--udp-port", str(port)])
