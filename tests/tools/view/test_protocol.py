"""Messages of the page: what a viewer may ask for, and numbers as JSON holds them."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_tools.view.protocol import (
    CancelTour,
    CommandError,
    Event,
    Look,
    Play,
    ReleaseRobots,
    Seek,
    Speed,
    StartTour,
    StopRobots,
    encode,
    read_command,
    rounded,
)


@pytest.mark.parametrize(
    ("entries", "command"),
    [
        ({"type": "look"}, Look()),
        (
            {"type": "look", "cells": True, "robots": ["b", "a"]},
            Look(frozenset({"a", "b"}), True),
        ),
        ({"type": "play"}, Play(True)),
        ({"type": "pause"}, Play(False)),
        ({"type": "speed", "speed": 2}, Speed(2.0)),
        ({"type": "seek", "t": 1700000000.25}, Seek(1700000000.25)),
        ({"type": "tour", "start": "museum"}, StartTour("museum")),
        ({"type": "tour", "cancel": True}, CancelTour()),
        ({"type": "stop"}, StopRobots()),
        ({"type": "release"}, ReleaseRobots()),
    ],
)
def test_command_is_read(entries: dict, command: object) -> None:
    assert read_command(json.dumps(entries)) == command


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no JSON"),
        ("[1]", "no JSON object"),
        ("[" * 4000, "no JSON"),
        ("{}", "type is null; allowed: look, play"),
        ('{"type": ["look"]}', "allowed: look"),
        ('{"type": "look", "cells": 1}', "cells is 1; allowed: true, false"),
        ('{"type": "look", "robots": "robot_a"}', "allowed: a list of names"),
        ('{"type": "look", "robots": [""]}', "allowed: a list of names"),
        (json.dumps({"type": "look", "robots": ["a"] * 65}), "65 robots; allowed: 64"),
        ('{"type": "look", "all": true}', 'unknown entry "all"; allowed: cells, robots'),
        ('{"type": "play", "t": 1}', 'unknown entry "t"; allowed: none'),
        ('{"type": "speed", "speed": 0}', "speed is 0; allowed: 0.1 to 20"),
        ('{"type": "speed", "speed": true}', "allowed: a finite number"),
        ('{"type": "seek"}', "t is null; allowed: a finite number"),
        ('{"type": "seek", "t": NaN}', "allowed: a finite number"),
        ('{"type": "seek", "t": 1' + "0" * 400 + "}", "allowed: a finite number"),
        ('{"type": "tour"}', 'wanted: either "start"'),
        ('{"type": "tour", "start": "x", "cancel": true}', 'wanted: either "start"'),
        ('{"type": "tour", "cancel": false}', 'wanted: either "start"'),
    ],
)
def test_malformed_command_is_refused_with_what_is_allowed(text: str, says: str) -> None:
    with pytest.raises(CommandError) as caught:
        read_command(text)
    assert says in str(caught.value)
    assert len(str(caught.value)) < 200  # also where the command is long


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)
_KINDS = st.sampled_from(["look", "play", "pause", "speed", "seek", "tour", "stop"])
_ENTRIES = st.dictionaries(
    st.sampled_from(["cells", "robots", "speed", "t", "start", "cancel"]), _JSON, max_size=3
)


@given(st.one_of(st.text(), _JSON.map(json.dumps), st.tuples(_KINDS, _ENTRIES).map(
    lambda pair: json.dumps({"type": pair[0], **pair[1]})
)))  # fmt: skip
def test_whatever_comes_is_a_command_or_refused(text: str) -> None:
    try:
        command = read_command(text)
    except CommandError:
        return
    if isinstance(command, Seek):
        assert math.isfinite(command.t)


def test_what_is_not_finite_is_null() -> None:
    assert [rounded(1.23456), rounded(math.nan), rounded(math.inf)] == [1.235, None, None]
    with pytest.raises(ValueError, match="JSON"):
        encode(Event(type="event", t=math.nan, text=""))
    assert encode(Event(type="event", t=1.5, text="é")) == '{"type":"event","t":1.5,"text":"é"}'
