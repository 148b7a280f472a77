"""What is wrong with an input, from plain figures."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrs_people_loc.health.findings import ERROR, OK, WARN, Code, Finding
from mrs_people_loc.health.inputs import InputState, of_input

IMAGE = "sensor_msgs/msg/Image"
WELL = InputState(
    "left/image_rect",
    "/a/left/image_rect",
    IMAGE,
    silent_s=0.1,
    rate_hz=9.96,
    received=100,
    publishers=[("/a/camera", IMAGE)],
)


def verdict(finding: Finding) -> tuple:
    return finding.level, finding.code, finding.message


def test_received_input_is_ok():
    assert of_input(WELL) == Finding(
        "left/image_rect",
        values={"rate_hz": "10.0", "silent_s": "0.1", "received": 100, "dropped": 0},
    )
    assert verdict(of_input(replace(WELL, refused=5))) == (OK, None, "ok")  # long ago


def test_dropped_messages_are_counted_by_reason():
    dropped = {"ImageError": 2, "jumped_back": 3}
    values = of_input(replace(WELL, dropped=dropped)).values
    assert values["dropped"] == 5
    assert (values["dropped.ImageError"], values["dropped.jumped_back"]) == (2, 3)


@pytest.mark.parametrize(
    ("changes", "code", "text"),
    [
        ({}, Code.NO_DATA, "no data on /a/left/image_rect for 7 s; publishers: 1"),
        ({"publishers": ()}, Code.NO_PUBLISHER, "publishers: 0"),
        ({"incompatible": "RELIABILITY"}, Code.WRONG_QOS, "incompatible QoS: RELIABILITY"),
        (
            {"publishers": [("/a/camera", "a/msg/B")]},
            Code.WRONG_TYPE,
            "published as a/msg/B, wanted: sensor_msgs/msg/Image",
        ),
        (
            {"publishers": (), "instead": ("/a/left/image_raw", "set images.rectified: false")},
            Code.OTHER_IMAGES,
            "/a/left/image_raw is published: set images.rectified: false",
        ),
        # Both are published: it is this one that is silent.
        ({"instead": ("/a/left/image_raw", "set it")}, Code.NO_DATA, "publishers: 1"),
        # What was refused before it went silent is not what is wrong now.
        ({"refused": 9, "refused_in_a_row": 9, "refused_lately": True}, Code.NO_DATA, "no data"),
    ],
)
def test_silence_has_a_reason(changes, code, text):
    finding = of_input(replace(WELL, silent_s=7.0, **changes))
    assert (finding.level, finding.code) == (ERROR, code)
    assert text in finding.message


def test_input_that_needs_one_message_may_be_silent_after_it():
    once = replace(WELL, silent_s=7.0, once=True)
    assert verdict(of_input(once))[:2] == (ERROR, Code.NO_DATA)
    assert verdict(of_input(replace(once, taken=True))) == (OK, None, "ok")
    refused = replace(once, refused=1, refused_in_a_row=1, last_error="frame_id is 'odom'")
    assert verdict(of_input(refused)) == (
        ERROR, Code.ALL_REFUSED, "none of 1 can be used; last: frame_id is 'odom'",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        ("ImageError", Code.ALL_REFUSED),
        ("StampError", Code.NO_STAMPS),
        ("UncalibratedError", Code.NO_CALIBRATION),
        ("OutdatedError", Code.OUTDATED),
    ],
)
def test_all_refused_is_an_error_and_some_refused_a_warning(kind, code):
    refused = replace(
        WELL, refused=40, refused_lately=True, last_error="why", last_kind=kind, refused_in_a_row=2
    )
    assert verdict(of_input(refused)) == (WARN, Code.SOME_REFUSED, "40 dropped; last: why")
    refused = replace(refused, refused_in_a_row=3)
    assert verdict(of_input(refused)) == (ERROR, code, "all of the last 3 refused; last: why")


def test_several_publishers_are_an_error_that_names_them():
    two = replace(WELL, publishers=[("/b/camera", IMAGE), ("/a/camera", IMAGE)], refused=3)
    for lately in (False, True):
        level, code, text = verdict(of_input(replace(two, refused_lately=lately)))
        assert (level, code) == (ERROR, Code.TWO_PUBLISHERS)
        assert text.startswith("2 publishers on /a/left/image_rect: /a/camera, /b/camera; one is")
    other_type = replace(WELL, publishers=[("/a/camera", IMAGE), ("/x", "a/msg/B")])
    assert verdict(of_input(other_type)) == (OK, None, "ok")  # it is not heard


def test_input_that_any_number_may_publish_is_ok_without_and_with_several():
    optional = replace(WELL, any_number=True)
    for publishers in ((), [("/a/camera", IMAGE), ("/b/camera", IMAGE)]):
        for silent_s in (0.1, 7.0):
            state = replace(optional, publishers=publishers, silent_s=silent_s)
            assert verdict(of_input(state)) == (OK, None, "ok")


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"incompatible": "RELIABILITY"}, Code.WRONG_QOS),
        ({"publishers": [("/a/camera", "a/msg/B")]}, Code.WRONG_TYPE),
        ({"silent_s": 0.1, "refused_in_a_row": 3, "last_error": "x"}, Code.ALL_REFUSED),
    ],
)
def test_unusable_publishers_of_such_an_input_are_reported(changes, code):
    state = replace(WELL, any_number=True, **{"silent_s": 7.0} | changes)
    assert verdict(of_input(state))[:2] == (ERROR, code)
