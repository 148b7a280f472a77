"""Findings of the guide: about its tour, and each robot of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mrs_people_loc.guiding.guidance import Guidance, Post, State
from mrs_people_loc.guiding.tour_control import second_guide, without_monitor
from mrs_people_loc.health.findings import ERROR, OK, WARN, Code, Finding

_TEXTS = {
    State.IDLE: "no tour",
    State.GATHERING: "gathers the group",
    State.LEADING: "leads",
    State.WAITING: "waits",
    State.AT_STOP: "at a stop",
    State.FINISHED: "the tour is finished",
    State.CANCELLED: "the tour has ended",
}


def of_walls(topic: str, *, is_known: bool) -> Finding:
    """Whether robots avoid walls.

    Args:
        topic: Full name of the map's topic.
        is_known: Whether a map has come.
    """
    if is_known:
        return Finding("walls")
    text = f"no map has come on {topic}: the robots of a tour do not keep clear of walls"
    return Finding("walls", WARN, text, code=Code.NO_MAP)


def of_tour(tour: str, guidance: Guidance, avoided: Iterable[str] = ()) -> Finding:
    """How the tour goes on.

    Args:
        tour: Its name.
        guidance: The last one.
        avoided: Names of the robots outside the tour that are avoided.
    """
    values: dict[str, object] = {"state": guidance.state.name.lower()}
    if tour:
        values |= {
            "tour": tour,
            "way_m": f"{guidance.way_m:.1f}",
            "length_m": f"{guidance.length_m:.1f}",
            "stop": guidance.stop,
            "people": len(guidance.people),
            "stragglers": len(guidance.stragglers),
            "lost": len(guidance.lost),
            "avoided": ", ".join(avoided),
        }
    text = guidance.reason or _TEXTS[guidance.state]
    if guidance.state == State.HALTED:
        text = f"the robots stand: {guidance.reason}"
        return Finding("tour", ERROR, text, values, Code.TOUR_HALTED)
    if guidance.state == State.STOPPED:
        text = f"{guidance.reason}: the robots stand until they are released (mrs tour release)"
        return Finding("tour", WARN, text, values, Code.TOUR_STOPPED)
    if guidance.lost:
        ids = ", ".join(str(number) for number in guidance.lost)
        text = f"the tour goes on without people who fell behind, by their ids: {ids}; {text}"
        return Finding("tour", WARN, text, values, Code.PEOPLE_LOST)
    return Finding("tour", OK, text, values)


def of_guides(topic: str, guides: Sequence[str]) -> Finding:
    """Whether this guide is the only one.

    Args:
        topic: Full name of `guide_status`.
        guides: Full names of the nodes that publish it; a single one may be left out.
    """
    if len(guides) < 2:
        return Finding("guides")
    text = f"{second_guide(topic, guides)}; a tour under way goes on, and none begins"
    return Finding("guides", ERROR, text, code=Code.TWO_PUBLISHERS)


def of_others(drivers: Mapping[str, Sequence[str]]) -> Finding:
    """Whether the guide alone drives the robots of a tour.

    Args:
        drivers: By robot, full names of the other nodes that publish its commands.
    """
    found = [f"{robot} by {', '.join(names)}" for robot, names in drivers.items() if names]
    if not found:
        return Finding("commands")
    text = f"robots of the tour are driven by others, too: {'; '.join(found)}; end them"
    return Finding("commands", WARN, text, code=Code.DRIVEN_BY_OTHERS)


def of_monitors(unmonitored: Sequence[str]) -> Finding:
    """Whether collision monitors drive all robots of the tour.

    Args:
        unmonitored: Names of those without one.
    """
    if not unmonitored:
        return Finding("monitors")
    return Finding("monitors", WARN, without_monitor(unmonitored), code=Code.NO_MONITOR)


def of_tour_robots(guidance: Guidance, distances: Mapping[str, float]) -> Iterable[Finding]:
    """Whether each robot takes part, by name.

    Args:
        guidance: The last one.
        distances: By robot, how far it is from its post [m].
    """
    for name in sorted({*guidance.posts, *guidance.faults}):
        if name in guidance.faults:
            text = f"takes no part in the tour: {guidance.faults[name]}"
            yield Finding(f"robot {name}", WARN, text, code=Code.TAKES_NO_PART)
        else:
            yield Finding(f"robot {name}", values=_values(guidance.posts[name], distances, name))


def _values(post: Post, distances: Mapping[str, float], name: str) -> dict[str, object]:
    values: dict[str, object] = {"role": post.role.name.lower()}
    if name in distances:
        values["distance_m"] = f"{distances[name]:.2f}"
    return values
