"""people_msgs/People, for social navigation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from geometry_msgs.msg import Point
from std_msgs.msg import Header

from mrs_people_loc.people import Person
from planner_node.others.naming import confidence, person_name


def people(header: Header, persons: Iterable[Person], messages: Any) -> Any:
    """People as a people_msgs/People.

    A velocity that is not known is zero there: NaN would become a NaN cost. People without an id
    have no name.

    Args:
        header: Stamp and frame.
        persons: The people.
        messages: The module `people_msgs.msg`.
    """
    return messages.People(header=header, people=[_person(person, messages) for person in persons])


def _person(person: Person, messages: Any) -> Any:
    x, y = map(float, person.position)
    vx, vy = (0.0, 0.0) if person.velocity is None else map(float, person.velocity)
    return messages.Person(
        name=person_name(person.id) if person.id else "",
        position=Point(x=x, y=y, z=0.0),
        velocity=Point(x=vx, y=vy, z=0.0),
        reliability=confidence(person),
    )
