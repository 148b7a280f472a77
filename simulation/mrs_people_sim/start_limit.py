"""How long a team may take to start: longer on a machine that has much to do."""

from __future__ import annotations

import math
import time
from collections.abc import Collection

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.diagnosis.load import Load

#: So long nothing may go on, on a machine that has nothing else to do [s].
_STILL_S = 60.0


class StartLimit:
    """Ends a wait once nothing has gone on for long, and names what keeps it.

    The time counts as far as the machine is there for it: at a load of 11 on 2 cores a second is
    0.18 s.
    """

    def __init__(self) -> None:
        self._began_s = self._last_s = time.monotonic()
        self._fewest = math.inf
        self._still_s = 0.0

    def check(self, waiting: Collection[str], *causes: str) -> None:
        """Looks at what is still waited for.

        Args:
            waiting: What is not ready; fewer than ever before are progress.
            causes: What else may be the reason, such as "rendering 0.4 of real time".

        Raises:
            PeopleLocError: Nothing has gone on for too long.
        """
        now_s, load = time.monotonic(), Load.now()
        passed_s, self._last_s = now_s - self._last_s, now_s
        self._still_s += load.share * passed_s
        if len(waiting) < self._fewest:
            self._fewest, self._still_s = len(waiting), 0.0
        if self._still_s > _STILL_S:
            raise PeopleLocError(
                f"not ready after {now_s - self._began_s:.0f} s: {', '.join(sorted(waiting))} "
                f"({', '.join([*causes, str(load)])})"
            )
