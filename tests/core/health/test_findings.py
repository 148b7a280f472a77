"""What is said of inputs, and of scans, from plain figures."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrs_people_loc.health.findings import ERROR, OK, STALE, WARN, Code, Stream, of_scans, of_stream

IMAGE = "sensor_msgs/msg/Image"
WELL = Stream("/a/left/image_rect", IMAGE, silent_s=0.1, publishers=[("/a/camera", IMAGE)])


def test_no_trouble_gives_ok():
    assert of_stream(WELL) == (OK, None, "ok")
    assert of_stream(replace(WELL, refused=5)) == (OK, None, "ok")  # long ago


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
        # Both are published: it is this one that stands still.
        ({"instead": ("/a/left/image_raw", "set it")}, Code.NO_DATA, "publishers: 1"),
        # What was refused before it went silent is not what is wrong now.
        ({"refused": 9, "refused_in_a_row": 9, "refused_lately": True}, Code.NO_DATA, "no data"),
    ],
)
def test_silent_input_is_an_error(changes, code, text):
    level, found, said = of_stream(replace(WELL, silent_s=7.0, **changes))
    assert (level, found) == (ERROR, code)
    assert text in said


def test_one_message_suffices_for_inputs_sent_once():
    once = replace(WELL, silent_s=7.0, once=True)
    assert of_stream(once)[:2] == (ERROR, Code.NO_DATA)
    assert of_stream(replace(once, taken=True)) == (OK, None, "ok")
    refused = replace(once, refused=1, refused_in_a_row=1, last_error="frame_id is 'odom'")
    assert of_stream(refused) == (
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
    assert of_stream(refused) == (WARN, Code.SOME_REFUSED, "40 dropped; last: why")
    level, found, text = of_stream(replace(refused, refused_in_a_row=3))
    assert (level, found, text) == (ERROR, code, "all of the last 3 refused; last: why")


def test_two_publishers_are_named_with_the_consequence():
    two = replace(WELL, publishers=[("/b/camera", IMAGE), ("/a/camera", IMAGE)], refused=3)
    for lately in (False, True):
        level, code, text = of_stream(replace(two, refused_lately=lately))
        assert (level, code) == (ERROR, Code.TWO_PUBLISHERS)
        assert text.startswith("2 publishers on /a/left/image_rect: /a/camera, /b/camera; one is")
    other_type = replace(WELL, publishers=[("/a/camera", IMAGE), ("/x", "a/msg/B")])
    assert of_stream(other_type) == (OK, None, "ok")  # it is not heard


@pytest.mark.parametrize(
    ("silent_s", "ahead_s", "wanted"),
    [
        (0.1, -0.2, (OK, None, "ok")),
        (9.0, -0.2, (STALE, Code.SCAN_SILENT, "no scan for 9 s")),
        (0.1, -9.0, (WARN, Code.STAMPS_OFF, "stamps are 9.0 s behind this machine's clock; so")),
        (0.1, 9.0, (WARN, Code.STAMPS_OFF, "stamps are 9.0 s ahead of this machine's clock; so")),
    ],
)
def test_age_is_not_reported_as_clock_offset(silent_s, ahead_s, wanted):
    assert of_scans(silent_s, ahead_s, "; so") == wanted


def test_codes_equal_the_published_values():
    assert f"{Code.NO_DATA}" == str(Code.NO_DATA) == Code("no_data").value
