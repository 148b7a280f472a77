"""A TF frame for each person, named as REP 155 has it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from std_msgs.msg import Header

from mrs_people_loc.people import Person
from planner_node.others.naming import person_name


def person_frames(header: Header, persons: Iterable[Person]) -> list[TransformStamped]:
    """Frames `person_<name>` of the people who have an id.

    The origin is the top of the head, or on the floor where the height is unknown; the axes are
    those of the parent, since headings are not known.

    Args:
        header: Stamp and parent frame.
        persons: The people.
    """
    made = []
    for person in persons:
        if person.id:
            frame = TransformStamped(
                header=header, child_frame_id=f"person_{person_name(person.id)}"
            )
            x, y = map(float, person.position)
            z = float(person.height) if math.isfinite(person.height) else 0.0
            frame.transform.translation = Vector3(x=x, y=y, z=z)
            frame.transform.rotation = Quaternion(w=1.0)
            made.append(frame)
    return made
