"""A bag as `mrs view` plays it."""

from __future__ import annotations

import base64
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.writer import BagWriter
from mrs_tools.view.playback import Playback
from mrs_tools.view.protocol import CancelTour, CommandError, Look, Play, Seek, Speed, encode
from mrs_tools.view.recorded import RecordedHead
from tools.made_bag import START_NS, Bag

ROOT = Path(__file__).parents[3]
START_S = START_NS / 1e9


class Page:
    """Keeps what is published, each message as JSON could hold it."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def __call__(self, message: Any) -> None:
        encode(message)
        self.messages.append(message)

    def all(self, kind: str) -> list[Any]:
        return [message for message in self.messages if message["type"] == kind]

    def wait(self, kind: str, fits: Callable[[Any], bool] = lambda message: True) -> Any:
        """The last message of a kind, once it fits."""
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            last = self.all(kind)[-1:]
            if last and fits(last[0]):
                return last[0]
            time.sleep(0.01)
        raise AssertionError(f"no such {kind}: {self.all(kind)[-1:]}")


@contextmanager
def played(path: Path, *, loop: bool = False) -> Iterator[tuple[Playback, Page]]:
    playback, page = Playback(path, loop=loop), Page()
    playback.start(page)
    try:
        yield playback, page
    finally:
        playback.close()


def write(path: Path, fill: Callable[[Bag], None]) -> Path:
    with BagWriter(path) as writer:
        fill(Bag(writer))
    return path


def walking(bag: Bag) -> None:
    """One person walks along x at 1 m/s for 20 s, first seen after 1 s; the truth is beside."""
    bag.truth(0, (0.0, 0.5))
    for ms in range(1000, 20_001, 200):
        x = ms / 1000
        bag.people(
            ms, (x, 0.0), ids=[7], velocities=[(1.0, 0.0)], coasting=[7] if ms > 19_000 else []
        )
        bag.truth(ms, (x, 0.5), (np.nan, np.nan))
        bag.pose_topic("robot_a", ms, x - 2.0, 0.0)
    for ms, text in ((1000, "7 joins"), (12_000, "7 \x1b falls behind")):
        bag.write("/events", ms, bag.make("std_msgs/msg/String", data=text))


def test_first_people_are_shown_then_those_of_any_time_with_their_trails(tmp_path):
    with played(write(tmp_path / "walk.mcap", walking)) as (playback, page):
        assert playback.hello()["bag"] == {"start": START_S, "end": START_S + 20.0}
        first = page.wait("state")
        assert first["t"] == START_S + 1.0
        assert [person["x"] for person in first["people"]] == [1.0]
        page.wait("event", lambda event: event["text"] == "7 joins")
        playback.control(Seek(START_S + 15.05))
        state = page.wait("state", lambda state: state["t"] == START_S + 15.0)
        assert state["age"] == pytest.approx(0.05, abs=0.001)
        (person,) = state["people"]
        assert (person["id"], person["x"], person["vx"], person["seen_s"]) == (7, 15.0, 1.0, 0.0)
        assert state["truth"] == [[15.0, 0.5]]
        assert [(one["name"], one["x"]) for one in state["robots"]] == [("robot_a", 13.0)]
        trail = np.array(state["trails"]["7"])
        assert trail[[0, -1]].tolist() == [[START_S + 7.2, 7.2, 0.0], [START_S + 15.0, 15.0, 0.0]]
        page.wait("event", lambda event: event["text"] == r"7 \x1b falls behind")
        # Back again: what was later is forgotten.
        playback.control(Seek(START_S + 2.0))
        state = page.wait("state", lambda state: state["t"] == START_S + 2.0)
        assert len(state["trails"]["7"]) == 6
        assert page.all("event")[-1]["text"] == "7 joins"


def test_bag_plays_as_fast_as_asked_to_its_end_and_begins_again(tmp_path):
    with played(write(tmp_path / "walk.mcap", walking)) as (playback, page):
        page.wait("time")
        playback.control(Seek(START_S + 19.0))
        page.wait("time", lambda now: now["t"] == START_S + 19.0)
        playback.control(Speed(4.0))
        began_s = time.monotonic()
        playback.control(Play(True))
        page.wait("time", lambda now: now["playing"])
        now = page.wait("time", lambda now: not now["playing"])
        assert time.monotonic() - began_s >= 0.25
        assert now["t"] == now["end"] == now["ready"] == START_S + 20.0
        # They are predicted for the last second, and last seen before it.
        (person,) = page.wait("state")["people"]
        assert person["predicted"]
        assert person["seen_s"] == 1.0
        playback.control(Play(True))
        page.wait("time", lambda now: now["playing"] and now["t"] < START_S + 10.0)


def test_bag_is_played_again_and_again_where_that_is_asked_for(tmp_path):
    path = write(tmp_path / "walk.mcap", walking)
    with played(path, loop=True) as (playback, page):
        page.wait("time", lambda now: now["playing"] and now["t"] > START_S + 1.0)
        playback.control(Seek(START_S + 19.8))
        page.wait("time", lambda now: now["t"] >= START_S + 19.8)
        page.wait("time", lambda now: now["playing"] and now["t"] < START_S + 10.0)
        page.wait("state", lambda state: state["people"] and state["people"][0]["x"] < 5.0)


def test_people_of_a_planner_before_the_new_name_of_its_topic_are_shown(tmp_path):
    def fill(bag: Bag) -> None:
        bag.people(0, (3.0, 0.0), ids=[1], topic="/people")

    with played(write(tmp_path / "old.mcap", fill)) as (_, page):
        assert page.wait("state")["people"][0]["x"] == 3.0


def test_people_of_a_bag_that_has_only_scans_are_found_meanwhile(tmp_path):
    def fill(bag: Bag) -> None:
        for ms in range(0, 2000, 100):
            bag.pose_topic("robot_a", ms, 0.0, 0.0)
            bag.points("robot_a", ms, (3.0, 0.0))

    with played(write(tmp_path / "scans.mcap", fill)) as (playback, page):
        state = page.wait("state", lambda state: len(state["people"]) == 1)
        assert state["people"][0]["x"] == pytest.approx(3.0, abs=0.05)
        page.wait("time", lambda now: now["ready"] == now["end"])
        (finding,) = page.wait("health", lambda health: health["level"] == "ok")["findings"]
        assert "found by this viewer" in finding["text"]
        assert not page.all("cells")
        playback.look(Look(cells=True))
        cells = np.reshape(page.wait("cells")["robots"]["robot_a"], (-1, 2))
        assert np.hypot(*(cells - (3.0, 0.0)).T).max() < 0.3


def decoded(jpeg: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(jpeg), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))


def test_images_are_made_for_robots_that_somebody_looks_at(tmp_path):
    path = ROOT / "bags" / "walking_group"
    with BagReader(path) as bag:
        head = RecordedHead(bag, "robot_a", BagRun(path).team.robots["robot_a"])
        now_ns = bag.start_ns + 8_000_000_000
        found = head.image(now_ns, None)
        assert found is not None
        time_ns, image = found
        assert 0 <= now_ns - time_ns < 300_000_000
        assert head.image(now_ns, time_ns) is None  # it is shown already
        shown, disparity = (decoded(image[part]) for part in ("image", "disparity"))
        assert shown.shape == disparity.shape == (120, 160, 3)
        coloured = np.ptp(shown.astype(int), axis=2) > 60
        assert 100 < coloured.sum() < coloured.size / 2  # boxes are drawn into a grey image
    with played(write(tmp_path / "walk.mcap", walking)) as (playback, page):
        page.wait("state")
        playback.look(Look(frozenset(["robot_a"])))
        image = page.wait("image")
        assert image["image"] is None
        assert image["note"] == "the bag has no images of it"


def test_a_tour_cannot_be_started_in_a_bag(tmp_path):
    playback = Playback(write(tmp_path / "walk.mcap", walking))
    with pytest.raises(CommandError, match="a bag has no tours"):
        playback.control(CancelTour())
    playback.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.mcap", "there is no such bag"),
        ("empty.mcap", "the file is empty"),
        ("folder", "the folder is no bag"),
        ("text.txt", "not a bag"),
        ("chatter.mcap", "no robot, i.e. no namespace .*; topics: /chatter"),
    ],
)
def test_what_is_no_bag_or_shows_nothing_is_refused_by_name(tmp_path, name, message):
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.txt").write_text("people")
    write(
        tmp_path / "chatter.mcap",
        lambda bag: bag.write("/chatter", 0, bag.make("std_msgs/msg/String", data="hello")),
    )
    with pytest.raises(PeopleLocError, match=rf"{re.escape(name)}: {message}"):
        Playback(tmp_path / name)
