"""The page of `mrs demo` and `mrs tour --simulate`: what it shows, and when it stays."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the page needs aiohttp")
pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")

from mrs_people_sim.page import TeamSource, is_watched
from mrs_tools.bags.writer import BagWriter
from mrs_tools.view.moment import Found, MapCells
from mrs_tools.view.protocol import CommandError, Look, Play
from mrs_tools.view.results import Results
from simulation.made_views import person
from tools.made_bag import START_NS, Bag
from tools.view.test_playback import Page


def recording(path: Path) -> Path:
    """Of a robot that sees one person, who is not in the bag."""
    with BagWriter(path) as writer:
        bag = Bag(writer)
        for ms in (0, 200, 400):
            bag.pose_topic("robot_a", ms, 0.0, 0.0)
            bag.points("robot_a", ms, (3.0, 0.0))
    return path


def test_page_shows_the_start_and_then_the_recording_with_what_was_found(tmp_path):
    source, page = TeamSource("walk"), Page()
    source.start(page)
    source.tell("Starting robot_a.")
    health = page.all("health")[-1]
    assert (health["level"], health["findings"][0]["text"]) == ("waiting", "Starting robot_a.")
    assert (source.hello()["mode"], source.hello()["title"]) == ("live", "walk")
    with pytest.raises(CommandError, match="nothing to control yet"):
        source.control(Play(True))
    source.look(Look(cells=True))

    results = Results(START_NS)
    cells = MapCells(np.array([[3.0, 0.0]]), np.array([0]))
    results.add(START_NS + 200_000_000, Found(START_NS, [person(7, 3.0, 0.5)], (), {}, cells))
    results.ready_ns = START_NS + 400_000_000
    source.show_bag(recording(tmp_path / "robot.mcap"), [], results)
    (hello,) = page.all("hello")
    assert (hello["mode"], hello["title"]) == ("bag", "walk")
    page.wait("time", lambda now: now["playing"])
    state: Any = page.wait("state", lambda state: state["people"])
    assert [(one["id"], one["x"], one["y"]) for one in state["people"]] == [(7, 3.0, 0.5)]
    assert state["t"] == START_NS / 1e9 + 0.2
    assert source.control(Play(True)) == "plays"
    source.close()


@pytest.mark.parametrize(
    ("terminal", "ci", "watched"), [(True, "", True), (True, "true", False), (False, "", False)]
)
def test_page_stays_only_where_somebody_may_end_it(terminal, ci, watched, monkeypatch):
    monkeypatch.setenv("CI", ci)
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: terminal, raising=False)
    assert is_watched() is watched
