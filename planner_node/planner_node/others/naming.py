"""What people are called in messages that have no numbers for them, and how sure they are there."""

from __future__ import annotations

from mrs_people_loc.people import Person

#: Confidence of a person who is seen, and of one who is predicted (REP 155, "Person Frame").
_SEEN, _PREDICTED = 1.0, 0.5


def person_name(number: int) -> str:
    """Name of a person: `p3`. A part of a topic's name may not begin with a digit."""
    return f"p{number}"


def group_name(number: int) -> str:
    """Name of a group: `g1`."""
    return f"g{number}"


def confidence(person: Person) -> float:
    """How sure it is that somebody is there: 1 where they are seen, less where predicted."""
    return _PREDICTED if person.coasting else _SEEN
