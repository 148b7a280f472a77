"""`mrs plot`: its pictures, that their axes agree, and what a head sees of the floor."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from typer.testing import CliRunner

from mrs_people_loc.config import Mounting
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.figures.bag_figures import figures_of, run_bag
from mrs_people_sim.figures.plots import TopView, draw_kept, seen_floor
from mrs_tools.bags.writer import BagWriter
from mrs_tools.cli import app
from tools.made_bag import Bag

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"
FORMATION = ROOT / "bags" / "paper_formation"
STAGES = ["fig07_raw", "fig13_zones", "fig14_noise", "fig15_cells"]
MAPS = ["fig16_map", "fig17_clusters", "fig18_people"]


@pytest.fixture(scope="module")
def formation() -> dict[str, Any]:
    return figures_of(run_bag(FORMATION, [PAPER]))


def axes_by_label(figure: Any, label: str) -> list[Any]:
    return [axes for axes in figure.axes if axes.get_xlabel() == label]


def test_all_figures_of_the_paper_are_drawn(formation):
    assert list(formation) == [
        "fig03_images", "fig04_ranging", *STAGES, *MAPS, "stages", "errors",
    ]  # fmt: skip


def test_all_maps_have_the_same_axes(formation):
    maps = [a for n in STAGES + MAPS for a in axes_by_label(formation[n], "x in map [m]")]
    assert len(maps) == 4 * 3 + 3
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in maps}) == 1
    assert {axes.get_aspect() for axes in maps} == {1.0}
    (left, right), (low, high) = maps[0].get_xlim(), maps[0].get_ylim()
    for x, y in ((6.3, 3.55), (0.2, 2.0), (0.2, 5.2), (3.2, 2.6), (2.0, 4.2)):  # robots, people
        assert left < x < right
        assert low < y < high


def test_all_side_views_have_the_same_axes(formation):
    sides = [
        axes
        for name in ["fig04_ranging", *STAGES]
        for axes in axes_by_label(formation[name], "x, ahead of the robot [m]")
    ]
    assert len(sides) == 5 * 3
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in sides}) == 1
    assert {axes.get_aspect() for axes in sides} == {1.0}


def test_every_axis_has_a_unit(formation):
    for name, figure in formation.items():
        for axes in figure.axes:
            x, y = axes.get_xlabel(), axes.get_ylabel()
            if name == "stages":
                assert "[%]" in y
                continue
            if name == "errors":
                assert "[cm]" in x
                continue
            hidden = not any(label.get_visible() for label in axes.get_xticklabels())
            assert "[m]" in x or "[px]" in x or hidden or not x, (name, x)
            assert "[m]" in y or "[px]" in y, (name, y)


def test_titles_contain_counts(formation):
    assert formation["fig18_people"].axes[0].get_title() == "5 people found, 5 there"
    assert "5 people" in formation["fig17_clusters"].axes[0].get_title()
    for name, what in (("fig07_raw", "points"), ("fig15_cells", "cells")):
        titles = [axes.get_title() for axes in axes_by_label(formation[name], "x in map [m]")]
        assert [title.split(":")[0] for title in titles] == ["robot_a", "robot_b", "robot_c"]
        assert all(title.endswith(what) for title in titles)


@pytest.mark.slow
def test_at_chooses_the_interval():
    def cells_of(at_s: float) -> np.ndarray:
        figures = figures_of(run_bag(FORMATION, [PAPER], at_s=at_s))
        (axes,) = figures["fig16_map"].axes
        return np.concatenate(
            [line.get_xydata() for line in axes.lines if "cells of" in str(line.get_label())]
        )

    first, again, later = cells_of(0.0), cells_of(0.05), cells_of(2.0)
    np.testing.assert_array_equal(first, again)
    assert first.shape != later.shape or not np.allclose(first, later)


def test_bag_of_scans_gives_the_possible_figures(tmp_path):
    path = tmp_path / "scans"
    with BagWriter(path) as writer:
        bag = Bag(writer)
        for ms in (0, 100, 200):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.points("robot_a", ms, (2, 1), (3, -1))
    ran = run_bag(path, [PAPER])
    figures = figures_of(ran)
    assert list(figures) == ["fig15_cells", *MAPS]
    assert figures["fig18_people"].axes[0].get_title() == "2 people found"
    assert any("nothing to compare with" in note for note in ran.result.notes)


@pytest.mark.slow
def test_command(tmp_path):
    out = tmp_path / "figures"
    result = CliRunner().invoke(
        app, ["plot", str(FORMATION), "--out", str(out), "--config", str(PAPER)]
    )
    assert result.exit_code == 0, result.output
    files = sorted(out.iterdir())
    assert len(files) == 11
    for file in files:
        data = file.read_bytes()
        assert data.startswith(b"\x89PNG")
        width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
        assert 400 <= width <= 2000
        assert 400 <= height <= 1400
    assert "fig03_images.png" in result.output


def test_command_reports_errors(tmp_path):
    (tmp_path / "taken").write_text("a file")
    for bag, out, text in (
        (tmp_path / "none", tmp_path / "out", "there is no such bag"),
        (FORMATION, tmp_path / "taken", "cannot be written"),
    ):
        result = CliRunner().invoke(app, ["plot", str(bag), "--out", str(out)])
        assert result.exit_code == 1
        assert text in result.stderr
        assert result.stderr.count("\n") == 1


# ------------------------------------------------------------------------------------ drawings


def head(**mounting: float) -> StereoCamera:
    return StereoCamera(
        width=160, height=120, fx=100.0, fy=100.0, cx=79.5, cy=59.5, baseline=0.1,
        mounting=Mounting(**mounting),
    )  # fmt: skip


def test_field_of_view_of_a_level_head_is_a_trapezoid():
    border = seen_floor(head(height=1.0), 1.0, 5.0)
    # The images' borders are 79.5 / 100 to the side.
    wanted = [(1, -0.795), (5, -3.975), (5, 3.975), (1, 0.795)]
    for corner in wanted:
        assert np.abs(border - corner).max(axis=1).min() < 1e-9
    assert border[:, 0].min() == pytest.approx(1.0)
    assert border[:, 0].max() == pytest.approx(5.0)


def test_field_of_view_of_a_head_looking_down_surrounds_it():
    border = seen_floor(head(height=2.5, pitch=math.pi / 2), 0.5, 3.0)
    # Nose down: the image's upper edge is ahead. On the floor, 2.5 m below, 0.595 and 0.795 of it.
    np.testing.assert_allclose(border.max(axis=0), (0.595 * 2.5, 0.795 * 2.5), atol=0.08)
    np.testing.assert_allclose(border.min(axis=0), (-0.595 * 2.5, -0.795 * 2.5), atol=0.08)


def test_head_looking_up_has_no_field_of_view_on_the_floor():
    assert seen_floor(head(height=3.0, pitch=-math.pi / 2), 0.5, 3.0).shape == (0, 2)


def test_bounds_contain_everything_except_absent_people():
    view = TopView(
        title="",
        stamp_ns=0,
        xy=np.array([[1.0, 1.0]]),
        robot=np.array([0]),
        cluster=np.array([0]),
        person=np.array([-1]),
        robots={"robot_a": Pose(0, 10.0, 0.0, math.pi)},
        views={"robot_a": np.array([[1.0, 0.0], [2.0, 0.5]])},
        people=[],
        groups=[],
        truth=np.array([[3.0, 7.0], [math.nan, math.nan]]),
    )
    assert view.bounds() == pytest.approx((0.5, 10.5, -1.0, 7.5))


def test_stages_without_points_are_drawn_empty():
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    kept = {"robot_a": {"cropped": 0.25, "foreground": None}}
    draw_kept(axes, kept, {"cropped": 0.15, "foreground": 0.73})
    assert [bar.get_height() for bar in axes.containers[0]] == [25.0, 0.0]
