"""The live world: what it publishes and when; the whole loop is in tests/ros."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("embreex", reason="the simulator needs embreex")

from mrs_people_loc import messages
from mrs_people_sim import live_world
from mrs_people_sim.live_world import Progress, make_message
from mrs_people_sim.motion import Place
from mrs_people_sim.robot_writer import camera_info, image_message
from mrs_people_sim.scene import Robot, Scene, StereoHead
from mrs_people_sim.sensors.heads import camera_models
from mrs_people_sim.writer import Messages

SOMEBODY = Place(1.0, 2.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0, 8.0])
def test_what_is_due_keeps_its_rate(rate: float) -> None:
    steps = [step for step in range(1, 401) if live_world._is_due(step, rate)]
    assert len(steps) == 400 * live_world.STEP_S * rate
    assert set(np.diff(steps)) <= {int(20 / rate), int(np.ceil(20 / rate))}


def test_images_and_calibrations_pass_the_reader_of_the_nodes() -> None:
    header = Messages(make_message).header("a/left", 1_500_000_000)
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    read = messages.read_image(image_message(make_message, header, image))
    assert np.array_equal(read, image)
    model = camera_models(StereoHead(width=32, height_px=24))["right"]
    info = messages.read_camera_info(camera_info(make_message, header, model))
    assert np.array_equal(info.p, model.p)
    assert info.p[0, 3] < 0.0


class Renderer:
    """A process; that of "slow" ends an instant only when it is let to."""

    ended = False

    def __init__(self, scene: Scene, robots: Sequence[str]) -> None:
        self.robots, self.cpu_s, self.shown = robots, 0.0, list[Any]()

    def wait(self) -> None: ...

    def end(self) -> None: ...

    @property
    def is_ready(self) -> bool:
        return not self.shown

    def show(self, instant: Any) -> None:
        self.shown.append(instant)

    def results(self) -> list[tuple[int, np.ndarray]]:
        if "slow" in self.robots and not Renderer.ended:
            return []
        done, self.shown = self.shown, []
        pixels = 7.0 if "slow" in self.robots else 5.0
        return [(instant.ns, np.array([pixels])) for instant in done]


def test_cameras_are_ready_once_all_have_rendered_the_instant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live_world, "_Renderer", Renderer)
    monkeypatch.setattr(live_world.os, "cpu_count", lambda: 2)
    scene = Scene(robots={"slow": Robot(), "b": Robot(), "c": Robot()})
    with live_world._Cameras(scene) as cameras:
        assert cameras.are_ready
        cameras.show(100, [SOMEBODY], {})
        assert cameras.seen() == []
        assert not cameras.are_ready
        monkeypatch.setattr(Renderer, "ended", True)
        assert cameras.seen() == [[7.0]]
        assert cameras.are_ready


@pytest.mark.parametrize(
    ("now", "text"),
    [
        (Progress(time=14.0, real_s=20.0, rendering_s=7.0), "rendering 0.4 of real time"),
        (Progress(time=14.0, real_s=20.0, rendering_s=3.0), "simulation 0.4 of real time"),
        (Progress(time=19.5, real_s=20.0, rendering_s=1.0), ""),
    ],
)
def test_pace_names_what_is_slow(now: Progress, text: str) -> None:
    assert now.pace(Progress(time=10.0, real_s=10.0, rendering_s=1.0)) == text
