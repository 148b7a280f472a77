"""vision_msgs/Detection3DArray, for whatever takes the boxes of a detector."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from geometry_msgs.msg import Vector3
from std_msgs.msg import Header

from mrs_people_loc.anthropometry import SHOULDER_BREADTH, TALLEST
from mrs_people_loc.people import Person
from mrs_ros.convert import floor_pose, place
from planner_node.others.naming import confidence, person_name

#: Class of every detection, as COCO's detectors call it.
PERSON = "person"


def detections(header: Header, persons: Iterable[Person], messages: Any) -> Any:
    """People as a vision_msgs/Detection3DArray.

    A box stands on the floor, as broad as shoulders and as high as the person; people of unknown
    height get the tallest. The pose of the hypothesis is the person's place on the floor, with its
    covariance. People without an id have none.

    Args:
        header: Stamp and frame, also of each detection.
        persons: The people.
        messages: The module `vision_msgs.msg`.
    """
    return messages.Detection3DArray(
        header=header, detections=[_detection(header, person, messages) for person in persons]
    )


def _detection(header: Header, person: Person, messages: Any) -> Any:
    height = float(person.height) if math.isfinite(person.height) else TALLEST
    centre = floor_pose(person.position)
    centre.position.z = height / 2.0
    hypothesis = messages.ObjectHypothesis(class_id=PERSON, score=confidence(person))
    return messages.Detection3D(
        header=header,
        results=[
            messages.ObjectHypothesisWithPose(
                hypothesis=hypothesis, pose=place(person.position, person.covariance)
            )
        ],
        bbox=messages.BoundingBox3D(
            center=centre, size=Vector3(x=SHOULDER_BREADTH, y=SHOULDER_BREADTH, z=height)
        ),
        id=person_name(person.id) if person.id else "",
    )
