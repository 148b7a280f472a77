"""Persons and groups as REP 155 (ROS4HRI) has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, Float32, Header

from mrs_people_loc.people import Group, Person
from mrs_ros.managed_node import ManagedNode
from planner_node.others.naming import confidence, group_name, person_name

#: REP 155 has all of it in this namespace, whatever that of the node; its libraries look there.
HUMANS = "/humans"
#: So many people have topics of their own at most; the others are not in the lists either.
MOST = 100
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Humans:
    """Publishes persons under `/humans`, while somebody subscribes to the list of them.

    Persons are anonymous: their ids do not outlast the planner.

    Args:
        node: The planner's node.
        messages: The module `hri_msgs.msg`.
    """

    def __init__(self, node: ManagedNode, messages: Any) -> None:
        self._node = node
        self._messages = messages
        self._lists = [
            node.offer(messages.IdsList, f"{HUMANS}/persons/{name}", 1)
            for name in ("tracked", "known")
        ]
        self._groups = node.offer(messages.Group, f"{HUMANS}/interactions/groups", 10)
        #: By id, publishers of `anonymous` and `location_confidence`.
        self._persons: dict[int, tuple[Any, Any]] = {}
        node.until_cleanup(lambda: self._keep(()))

    def publish(self, header: Header, persons: Sequence[Person], groups: Sequence[Group]) -> None:
        """Publishes those who are there now; the topics of those who have left are removed."""
        if any(publisher.get_subscription_count() for publisher in self._lists):
            there = {person.id: person for person in persons if person.id}
            self._publish_persons(header, [there[number] for number in sorted(there)[:MOST]])
        else:
            self._keep(())
        if self._groups.get_subscription_count():
            for group in groups:
                if group.id:
                    self._groups.publish(group_message(header, group, self._messages))

    def _publish_persons(self, header: Header, persons: Sequence[Person]) -> None:
        self._keep([person.id for person in persons])
        for person in persons:
            self._persons[person.id][1].publish(Float32(data=confidence(person)))
        names = [person_name(person.id) for person in persons]
        for publisher in self._lists:
            publisher.publish(self._messages.IdsList(header=header, ids=names))

    def _keep(self, numbers: Sequence[int]) -> None:
        """Makes the topics of these persons, and removes those of others."""
        for number in set(self._persons).difference(numbers):
            for publisher in self._persons.pop(number):
                self._node.destroy_lifecycle_publisher(publisher)
        for number in numbers:
            if number not in self._persons:
                space = f"{HUMANS}/persons/{person_name(number)}"
                made = [
                    self._node.create_lifecycle_publisher(kind, f"{space}/{name}", qos)
                    for kind, name, qos in (
                        (Bool, "anonymous", _LATCHED),
                        (Float32, "location_confidence", 1),
                    )
                ]
                for publisher in made:
                    publisher.on_activate(None)  # the others were with the node
                self._persons[number] = made[0], made[1]
                made[0].publish(Bool(data=True))


def group_message(header: Header, group: Group, messages: Any) -> Any:
    """A group as a hri_msgs/Group.

    Args:
        header: Stamp and frame.
        group: The group.
        messages: The module `hri_msgs.msg`.
    """
    return messages.Group(
        header=header,
        group_id=group_name(group.id),
        members=[person_name(number) for number in group.members],
    )
