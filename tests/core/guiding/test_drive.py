import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.guiding.driving import Robot, World, post
from mrs_people_loc.guiding.drive import limit


def test_limit_falls_to_zero_at_the_timeout() -> None:
    assert [limit(age, 0.4) for age in (0.0, 0.2, 0.3, 0.4, 9.0)] == pytest.approx(
        [1.0, 1.0, 0.5, 0.0, 0.0]
    )


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 3.0), st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_post_is_reached_and_stood_on(away: float, bearing: float, yaw: float) -> None:
    robot = Robot(0.0, 0.0, 0.0, post(away * math.cos(bearing), away * math.sin(bearing), yaw))
    World([robot]).run(13.0)
    assert robot.post is not None
    assert np.linalg.norm(robot.xy - robot.post.xy) < 0.12
    assert abs(math.remainder(robot.yaw - yaw, 2 * math.pi)) < 0.15
    assert (robot.track[-20:, 3:] == 0.0).all()
