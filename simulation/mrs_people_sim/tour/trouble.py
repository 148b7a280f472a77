"""What goes wrong on a simulated tour: processes of the team that are killed, and come back."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from mrs_people_loc.errors import ConfigError

_FORM = re.compile(r"(?P<who>[^@]+)@(?P<at>\d+(\.\d+)?)(-(?P<back>\d+(\.\d+)?))?")


@dataclass(frozen=True)
class Kill:
    """A process that is killed.

    Attributes:
        who: Name of a robot, `planner`, or `guide`, whose end is the end of the tour.
        at_s: When, from the beginning of the tour [s].
        back_s: When it is started again, likewise; None: never.
    """

    who: str
    at_s: float
    back_s: float | None = None


def read_kill(text: str, who: Sequence[str]) -> Kill:
    """What `--kill` says: NAME@T or NAME@T1-T2.

    Args:
        text: Such as `robot_b@20`, `planner@15-25`.
        who: Which names there are.

    Raises:
        ConfigError: It says something else.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise ConfigError(
            f"--kill {text}: wanted NAME@T or NAME@T1-T2 in seconds, such as planner@15-25"
        )
    if found["who"] not in who:
        raise ConfigError(f"--kill {text}: there is no {found['who']}; allowed: {', '.join(who)}")
    at_s = float(found["at"])
    back_s = float(found["back"]) if found["back"] else None
    if back_s is not None and back_s <= at_s:
        raise ConfigError(f"--kill {text}: it is back at {back_s:g} s; allowed: after {at_s:g} s")
    return Kill(found["who"], at_s, back_s)
