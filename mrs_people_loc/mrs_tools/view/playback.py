"""A bag in the browser: the source of `mrs view BAG`.

All viewers see the same, as in front of a projector: who plays, stops or seeks does it for all.
Times are those at which messages were recorded. A bag without people, but with images or scans of
robots, is run through the pipeline meanwhile (`results`).
"""

from __future__ import annotations

import dataclasses
import heapq
import threading
import time
import traceback
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.sources import read_grid, robots_of
from mrs_tools.diagnosis.facts import ERROR, OK, WARN
from mrs_tools.plain import plain
from mrs_tools.view import protocol
from mrs_tools.view.health import health_of
from mrs_tools.view.moment import TRAIL_NS, Moment, seconds
from mrs_tools.view.pictures import grid_of
from mrs_tools.view.protocol import CommandError, Control, Hello, Look, Play, Publish, Seek, Speed
from mrs_tools.view.recorded import Recorded, RecordedHead, Told, no_image, people_topic
from mrs_tools.view.results import Computed, Results

#: A bag that is played is looked at so often; one that stands still, so often, for what is computed
#: meanwhile [s].
_TICK_S, _STANDING_S = 1.0 / 30.0, 0.5
#: Images are made, and health is looked at, at most so often [s].
_IMAGES_S, _HEALTH_S = 0.1, 1.0
#: After a seek, trails are told for so long: a viewer may miss the first state [s].
_TRAILS_S = 0.5
#: Messages that cannot be used: so many topics and reasons are told.
_UNUSED = 3


@dataclasses.dataclass(frozen=True)
class _Wish:
    """What viewers want of the player.

    Attributes:
        playing: Whether the bag is played.
        speed: Times as fast as recorded.
        seek_ns: Where to go [ns]; None: nowhere.
        look: What they look at.
        closing: Whether it is over.
    """

    playing: bool = False
    speed: float = 1.0
    seek_ns: int | None = None
    look: Look = dataclasses.field(default_factory=Look)
    closing: bool = False


class Playback:
    """A bag, played for viewers; a `Source`.

    Args:
        path: The bag.
        configs: Parameter files of its team, later ones win; the one beside the bag is read, too.
        results: People of a team that ran on the bag, in place of those in it.
        loop: Whether it is played at once, and again and again.

    Raises:
        PeopleLocError: It is no bag, has nothing to show, or a file is wrong.
    """

    def __init__(
        self,
        path: Path,
        configs: Sequence[Path] = (),
        results: Results | None = None,
        *,
        loop: bool = False,
    ) -> None:
        self._path, self._loop = path, loop
        self._wish, self._woken = _Wish(playing=loop), False
        self._changed = threading.Condition()
        self._position_ns = 0
        # One thread reads the bag: a connection to SQLite belongs to the thread that makes it.
        self._thread = ThreadPoolExecutor(1, "bag")
        with ExitStack() as on_error:
            on_error.callback(self._thread.shutdown)
            self._bag = self._thread.submit(BagReader, path).result()
            on_error.callback(self._thread.submit, self._bag.close)
            has_people = people_topic(self._bag) is not None
            self._run = None
            if robots_of(self._bag) or not has_people:
                self._run = BagRun(path, configs, localize=True)
            on_error.pop_all()
        if results is None and self._run is not None and not has_people:
            results = Computed(self._run)
        self._results = results

    # ---- Source ----

    def hello(self) -> Hello:
        """What each viewer gets first."""
        return Hello(
            type="hello",
            version=protocol.VERSION,
            mode="bag",
            title=plain(self._path.name),
            control=False,
            bag=protocol.Span(start=seconds(self._bag.start_ns), end=seconds(self._bag.end_ns)),
            tours=[],
        )

    def start(self, publish: Publish) -> None:
        """Shows the first people, or the end."""
        if self._results is not None:
            self._results.start()
        self._thread.submit(self._play, publish)

    def look(self, wanted: Look) -> None:
        """Takes what viewers look at."""
        self._want(look=wanted)

    def control(self, command: Control) -> str:
        """Plays, stops, seeks or sets the speed, for all viewers.

        Raises:
            CommandError: It is a command for tours.
        """
        if isinstance(command, Play):
            again = command.playing and self._position_ns >= self._bag.end_ns
            if again:
                self._want(seek_ns=self._bag.start_ns)
            self._want(playing=command.playing)
            return "plays" if command.playing else "stands still"
        if isinstance(command, Speed):
            self._want(speed=command.speed)
            return f"{command.speed:g} times as fast as recorded"
        if isinstance(command, Seek):
            limits = seconds(self._bag.start_ns), seconds(self._bag.end_ns)
            t = min(max(command.t, limits[0]), limits[1])
            self._want(seek_ns=round(t * 1e9))
            return f"{t - limits[0]:.1f} s after the beginning"
        raise CommandError("a bag has no tours to start or cancel")

    def close(self) -> None:
        """Ends, and waits for it."""
        self._want(closing=True)
        if self._results is not None:
            self._results.close()
        self._thread.submit(self._bag.close)
        self._thread.shutdown()

    # ---- the thread ----

    def _want(self, **changes: object) -> None:
        with self._changed:
            self._wish = dataclasses.replace(self._wish, **changes)  # type: ignore[arg-type]
            self._woken = True
            self._changed.notify()

    def _next_wish(self) -> _Wish:
        """What is wanted, once something new is, or it is time to go on."""
        with self._changed:
            period_s = _TICK_S if self._wish.playing else _STANDING_S
            self._changed.wait_for(lambda: self._woken, period_s)
            wish, self._woken = self._wish, False
            self._wish = dataclasses.replace(wish, seek_ns=None)
            return wish

    def _play(self, publish: Publish) -> None:
        try:
            self._play_bag(publish)
        except PeopleLocError as err:  # damaged in its midst: the page stays and says so
            publish(health_of([], [_finding(ERROR, "bag", str(err))]))
        except Exception as err:  # nobody waits for this thread's result
            traceback.print_exc()
            publish(health_of([], [_finding(ERROR, "mrs view", f"the player has failed: {err}")]))

    def _play_bag(self, publish: Publish) -> None:
        player = _Player(self._bag, self._run, self._results, publish)
        player.begin()
        last_s, was_playing = time.monotonic(), False
        while not (wish := self._next_wish()).closing:
            now_s = time.monotonic()
            passed_ns = round((now_s - last_s) * wish.speed * 1e9) if was_playing else 0
            last_s, was_playing = now_s, wish.playing
            if wish.seek_ns is not None:
                player.seek(wish.seek_ns)
            elif wish.playing:
                player.advance(passed_ns)
            self._position_ns = player.position_ns
            if wish.playing and player.position_ns >= self._bag.end_ns:
                if self._loop:
                    self._want(seek_ns=self._bag.start_ns)
                else:
                    self._want(playing=False)
            player.show(wish)


class _Player:
    """Where a bag is, and what of it is published.

    Args:
        bag: The bag, open.
        run: The team of its robots; None: it has none.
        results: Its people; None: those that it has itself.
        publish: Takes the messages.

    Attributes:
        position_ns: Bag time that is shown [ns].
    """

    def __init__(
        self, bag: BagReader, run: BagRun | None, results: Results | None, publish: Publish
    ) -> None:
        self._bag, self._run, self._results, self._publish = bag, run, results, publish
        self._recorded = Recorded(bag, with_people=results is None)
        self._events: list[tuple[int, str]] = []
        self._heads: dict[str, RecordedHead] = {}
        self._notes: list[protocol.Finding] = []
        for name, config in run.team.robots.items() if run is not None else ():
            try:
                self._heads[name] = RecordedHead(bag, name, config)
            except PeopleLocError as err:
                self._notes.append(_finding(WARN, name, str(err)))
        self.position_ns = bag.start_ns
        self._moment = self._new_moment()
        self._has_begun = False
        self._look, self._changes, self._told_events = Look(), -1, 0
        self._trails_until_s = self._images_s = self._health_s = 0.0
        self._images_ns: dict[str, int] = {}
        self._last: dict[str, protocol.Message] = {}

    # ---- position ----

    def begin(self) -> None:
        """Shows the map and the first people; reads the events."""
        frame = "map" if self._run is None else self._run.team.planner.map_frame
        grid = read_grid(self._bag, frame)
        shown = None if grid is None else grid_of(grid)
        self._publish(protocol.Map(type="map", walls=[], grid=shown))
        results = self._results
        first_ns = self._recorded.first_people_ns() if results is None else results.first_ns
        self.seek(first_ns or self._bag.start_ns)
        self._has_begun = first_ns is not None
        self.show(_Wish())
        self._events = self._recorded.events()
        self._tell_events()

    def seek(self, to_ns: int) -> None:
        """Goes to a bag time [ns]."""
        self._has_begun = True
        self.position_ns = min(to_ns, self._ready_ns())
        self._moment, self._changes = self._new_moment(), -1
        self._feed(self.position_ns - TRAIL_NS)
        self._trails_until_s = time.monotonic() + _TRAILS_S
        self._images_ns.clear()
        self._told_events = 0

    def advance(self, by_ns: int) -> None:
        """Goes on by a duration [ns], as far as people are known."""
        before_ns = self.position_ns
        self.position_ns = max(before_ns, min(before_ns + by_ns, self._ready_ns()))
        self._feed(before_ns)

    def _feed(self, after_ns: int) -> None:
        """Feeds the moment with what was told after a bag time, until the position."""
        for time_ns, tell in self._between(after_ns, self.position_ns):
            tell(self._moment, time_ns)

    def _between(self, after_ns: int, until_ns: int) -> Iterator[tuple[int, Told]]:
        recorded = self._recorded.between(after_ns, until_ns)
        if self._results is None:
            return recorded
        found = self._results.between(after_ns, until_ns)
        return heapq.merge(recorded, found, key=itemgetter(0))

    def _new_moment(self) -> Moment:
        views = {name: head.view for name, head in self._heads.items()}
        return Moment({name: view for name, view in views.items() if view is not None})

    def _ready_ns(self) -> int:
        return self._bag.end_ns if self._results is None else self._results.ready_ns

    # ---- what is shown ----

    def show(self, wish: _Wish) -> None:
        """Publishes what is new."""
        results, now_s = self._results, time.monotonic()
        if not self._has_begun and results is not None and results.first_ns is not None:
            self.seek(results.first_ns)
        if self._changes != self._moment.changes:
            self._changes = self._moment.changes
            with_trails = now_s < self._trails_until_s
            self._publish(self._moment.state(self.position_ns, with_trails=with_trails))
        self._tell_events()
        self._publish_new("time", self._time(wish))
        if wish.look != self._look:
            self._look = wish.look
            self._images_ns.clear()
            self._last.pop("cells", None)
        cells = self._moment.cells() if wish.look.cells else None
        if cells is not None:
            self._publish_new("cells", cells)
        if now_s - self._health_s >= _HEALTH_S:
            self._health_s = now_s
            self._publish_new("health", self._health())
        if now_s - self._images_s >= _IMAGES_S or not self._images_ns:
            self._images_s = now_s
            for robot in wish.look.robots:
                self._show_image(robot)

    def _publish_new(self, kind: str, message: protocol.Message) -> None:
        """Publishes a message, unless the last one of its kind was the same."""
        if self._last.get(kind) != message:
            self._last[kind] = message
            self._publish(message)

    def _show_image(self, robot: str) -> None:
        head = self._heads.get(robot)
        shown_ns = self._images_ns.get(robot)
        if head is None:
            found = None if shown_ns == 0 else (0, no_image(robot, "the bag has no images of it"))
        else:
            found = head.image(self.position_ns, shown_ns)
        if found is not None:
            self._images_ns[robot], image = found
            self._publish(image)

    def _tell_events(self) -> None:
        """Publishes the events up to here that were not told yet, the last ones of them."""
        events = self._events if self._results is None else self._results.events
        until = bisect_right(events, self.position_ns, key=itemgetter(0))
        for time_ns, text in events[max(self._told_events, until - protocol.EVENTS_KEPT) : until]:
            self._publish(protocol.Event(type="event", t=seconds(time_ns), text=text))
        self._told_events = until

    def _time(self, wish: _Wish) -> protocol.Time:
        return protocol.Time(
            type="time",
            t=seconds(self.position_ns),
            start=seconds(self._bag.start_ns),
            end=seconds(self._bag.end_ns),
            ready=seconds(self._ready_ns()),
            playing=wish.playing,
            speed=wish.speed,
        )

    def _health(self) -> protocol.Health:
        """How the team was when it was recorded, and what is to be said of the bag."""
        own = [*self._notes, *(_finding(OK, "bag", plain(note)) for note in self._run_notes())]
        reported = None if self._results else self._moment.checks(self.position_ns)
        if self._results is not None:
            level, text = self._results.status()
            own.append(_finding(level, "people", text))
        elif reported is None:
            text = "the bag has no report of the team on /diagnostics at this time"
            own.append(_finding(OK, "bag", text))
        for reason, count in self._recorded.unused.most_common(_UNUSED):
            own.append(_finding(WARN, "bag", f"{count} messages cannot be used: {reason}"))
        return health_of(reported or (), own)

    def _run_notes(self) -> Sequence[str]:
        return [] if self._run is None else self._run.notes


def _finding(level: str, subject: str, text: str) -> protocol.Finding:
    return protocol.Finding(
        level=level,  # type: ignore[typeddict-item]
        subject=subject,
        text=text,
        advice="",
        follows=[],
    )
