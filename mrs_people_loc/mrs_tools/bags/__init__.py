"""Bags: reading, writing, and running one through the pipeline in this process.

    from mrs_tools.bags import BagRun

    run = BagRun("bags/paper_formation")
    for interval in run.intervals():
        interval.people.persons         # as the planner would publish them
    run.truth().positions               # where the people truly are, if the bag says

The names below are public, see `docs/python.md`.
"""

from typing import TYPE_CHECKING

from mrs_people_loc.exports import public_names

if TYPE_CHECKING:
    from mrs_tools.bags.offline import BagRun as BagRun
    from mrs_tools.bags.offline import Interval as Interval
    from mrs_tools.bags.reader import BagReader as BagReader
    from mrs_tools.bags.records import Truth as Truth
    from mrs_tools.bags.sources import RobotView as RobotView
    from mrs_tools.bags.truth import read_truth as read_truth
    from mrs_tools.bags.writer import BagWriter as BagWriter
else:
    __all__, __getattr__, __dir__ = public_names(
        __name__,
        {
            "offline": "BagRun Interval",
            "records": "Truth",
            "reader": "BagReader",
            "sources": "RobotView",
            "truth": "read_truth",
            "writer": "BagWriter",
        },
    )
