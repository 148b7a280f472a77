"""How the nodes use the network: the shipped Fast DDS profile."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

#: Where Fast DDS looks for its profiles.
PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def use_shipped_profile() -> None:
    """Points Fast DDS to `config/fastdds/team.xml`, where the user does not name another file.

    Before the first ROS context is made. Other middlewares do not look there.
    """
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)  # a pip install sets nothing
    shares = [Path(sys.prefix, "share", "mrs_people_loc")]  # ... or another ROS is sourced
    with contextlib.suppress(PackageNotFoundError):
        shares.insert(0, Path(get_package_share_directory("mrs_people_loc")))
    for share in shares:
        profile = share / "config" / "fastdds" / "team.xml"
        if profile.is_file():
            os.environ.setdefault(PROFILES_FILE, str(profile))
            return
