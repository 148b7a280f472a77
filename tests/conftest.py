"""What every test needs. No ROS here: the core's tests also run where there is none."""

import os
import sys

# A pip install sets nothing, and the ament index is not found without it.
os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
