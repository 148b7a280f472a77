"""What holds for every finding."""

from __future__ import annotations

import pytest

from mrs_people_loc.health.findings import (
    ERROR,
    OK,
    STALE,
    WARN,
    Code,
    Finding,
    of_state,
    without_clock,
)


@pytest.mark.parametrize(
    ("level", "code"), [(WARN, None), (ERROR, None), (STALE, None), (OK, Code.NO_DATA)]
)
def test_findings_have_a_code_unless_they_are_ok(level, code):
    with pytest.raises(ValueError, match=r"finding scan: level .* with code"):
        Finding("scan", level, "text", code=code)


def test_codes_equal_the_published_values():
    assert f"{Code.NO_DATA}" == str(Code.NO_DATA) == Code("no_data").value


def test_state_of_a_node():
    assert of_state(active=True, values={"cpu_percent": "3"}) == Finding(
        "state", OK, "active", {"cpu_percent": "3"}
    )
    inactive = of_state(active=False, values={"cpu_percent": "3"})
    assert (inactive.level, inactive.code) == (STALE, Code.INACTIVE)
    assert inactive.values == {}


def test_without_a_clock_no_stamp_is_early_or_late():
    clock, silent, okay = without_clock(
        [
            Finding("robot a", ERROR, "its clock is off", {"age_s": "1"}, Code.CLOCK_ASTRAY),
            Finding("odom", ERROR, "no data", {}, Code.NO_DATA),
            Finding("pairs"),
        ]
    )
    assert clock == Finding("robot a", STALE, "waits for /clock", {"age_s": "1"}, Code.NO_CLOCK)
    assert silent.code == Code.NO_DATA
    assert okay == Finding("pairs")
    (stamps,) = without_clock([Finding("scan", WARN, "stamps", {}, Code.STAMPS_OFF)])
    assert (stamps.level, stamps.code) == (STALE, Code.NO_CLOCK)
