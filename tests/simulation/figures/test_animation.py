"""Animations: trails, one palette for all pictures, a map that stays where it is, the command."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image, ImageSequence
from typer.testing import CliRunner

from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.figures import plots
from mrs_people_sim.figures.animation import (
    _Film,
    animate,
    headline,
    nearest,
    palette_of,
    with_trails,
)
from mrs_people_sim.figures.plots import TopView
from mrs_tools.cli import app
from simulation.made_views import group_of, person, view, walk

ROOT = Path(__file__).resolve().parents[3]
FORMATION = ROOT / "bags" / "paper_formation"
RED = np.round(255 * np.array(to_rgb(plots.AWAY))).astype(np.uint8)


def pictures_of(path: Path) -> list[np.ndarray]:
    result = []
    with Image.open(path) as film:
        for picture in ImageSequence.Iterator(film):
            assert picture.info["duration"] == 200
            result.append(np.asarray(picture.convert("RGB")))
    return result


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    path = tmp_path_factory.mktemp("film") / "walk.gif"
    animate(walk(), path)
    return pictures_of(path)


@pytest.mark.slow
def test_animation_has_five_pictures_per_second(pictures):
    assert len(pictures) == 21


@pytest.mark.parametrize("span_s", [-1, 4 * 365 * 86_400])
def test_jumping_clocks_are_refused(tmp_path, span_s):
    """Stamps years apart would take 26 GiB."""
    first, *_, last = walk()
    last = dataclasses.replace(last, stamp_ns=first.stamp_ns + span_s * 10**9)
    with pytest.raises(PeopleLocError, match=f": {span_s} s in between; allowed .*: 0 to 3600"):
        animate([first, last], tmp_path / "walk.gif")
    assert not list(tmp_path.iterdir())


def test_only_the_map_and_its_title_change(pictures):
    height = len(pictures[0])
    changed = np.any([(p != pictures[0]).any(axis=2) for p in pictures], axis=0)
    rows, columns = np.nonzero(changed)
    assert columns.min() > 50  # beyond the labels of the y axis
    assert rows.max() < height - 75  # above those of the x axis and the legend
    assert rows.min() < 30  # the time
    assert changed.mean() > 0.02


def test_stragglers_are_red(pictures):
    # The legend says what red is, in every picture; on the map it comes after 2 s.
    red = [int((p[:-75] == RED).all(axis=2).sum()) for p in pictures]
    assert not any(red[:10])
    assert all(count > 20 for count in red[10:])


def test_trails_cover_the_last_seconds_of_present_people():
    views = [view(s, *(person(w, s, w) for w in ((1, 2) if s != 7 else (1,)))) for s in range(10)]
    trails = [v.trails for v in with_trails(views)]
    assert list(trails[0]) == [1, 2]
    np.testing.assert_array_equal(trails[0][1], [[0, 1]])
    np.testing.assert_array_equal(trails[9][1], [[s, 1] for s in (5, 6, 7, 8, 9)])
    assert list(trails[7]) == [1]
    np.testing.assert_array_equal(trails[9][2], [[s, 2] for s in (5, 6, 8, 9)])


def test_people_without_an_id_have_no_trail():
    views = [view(s, person(0, s, 0), person(0, s, 1)) for s in range(3)]
    assert [v.trails for v in with_trails(views)] == [{}, {}, {}]


def test_people_are_labelled():
    people = person(7, 1, 1), person(3, 4, 1, coasting=True), person(0, 2, 2, velocity=None)
    axes = Figure().subplots()
    plots.draw_people(axes, view(0.0, *people, groups=[group_of(people[0], stragglers={3: 4.4})]))
    texts = {text.get_text(): text for text in axes.texts if text.get_text()}
    assert list(texts) == ["7", "3 (4 s)", "3"]
    assert texts["3 (4 s)"].get_color() == plots.AWAY != texts["7"].get_color()
    circles: list[Any] = [patch.get_edgecolor() for patch in axes.patches]
    assert [circle[3] for circle in circles] == [1.0, pytest.approx(0.4), 1.0]
    assert circles[1][:3] == pytest.approx(to_rgb(plots.AWAY))


def test_legend_lists_the_drawn_kinds():
    def labels(*views: TopView) -> list[str]:
        axes = Figure().subplots()
        plots.legend_of_people(axes, views)
        return axes.get_legend_handles_labels()[1]

    assert labels(view(0.0, person(1, 0, 0))) == ["people (3 sigma)"]
    assert labels(*walk()) == ["people (3 sigma)", "fallen behind or left", "centre of the group"]
    assert "predicted, not seen" in labels(view(0.0, person(1, 0, 0, coasting=True)))


def test_walls_are_drawn_as_in_the_grid():
    data = np.zeros((2, 3), dtype=np.int8)
    data[1, 2] = 100
    turned = OccupancyGrid(resolution=0.5, x=1.0, y=2.0, yaw=np.pi / 2, data=data)
    axes = Figure(figsize=(4, 4)).add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    shown = view(0.0, grid=turned)
    plots.draw_walls(axes, shown)
    axes.set_xlim(-1, 3)
    axes.set_ylim(1, 5)
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    rows, columns = np.nonzero(np.asarray(canvas.buffer_rgba())[:, :, 0] < 255)
    # Cell (2, 1) is 1.0 to 1.5 m along and 0.5 to 1.0 m across: turned by 90 degrees about (1, 2).
    assert columns.min() / 100 - 1 == pytest.approx(0.0, abs=0.03)
    assert columns.max() / 100 - 1 == pytest.approx(0.5, abs=0.03)
    assert 5 - rows.max() / 100 == pytest.approx(3.0, abs=0.03)
    assert 5 - rows.min() / 100 == pytest.approx(3.5, abs=0.03)


def test_title_describes_people_and_groups():
    two = person(1, 0, 0), person(2, 0, 1)
    assert headline(view(0.0)) == "0 people"
    assert headline(view(0.0, two[0])) == "1 person"
    one, both = group_of(two[0], velocity=np.array([0.3, 0.4])), group_of(*two)
    assert headline(view(0.0, *two, groups=[one])) == "2 people, 1 in group 1, walking at 0.5 m/s"
    assert (
        headline(view(0.0, *two, groups=[both])) == "2 people, all in group 1, walking at 1.0 m/s"
    )
    stands = group_of(*two, velocity=np.array([0.0, 0.05]))
    assert headline(view(0.0, *two, groups=[stands])) == "2 people, all in group 1, standing"
    unknown = group_of(*two, velocity=None, id=0)
    assert headline(view(0.0, *two, groups=[unknown])) == "2 people"


def test_palette_has_frequent_and_distinct_colours():
    grey = np.repeat(np.arange(0, 250, dtype=np.uint8)[:, np.newaxis], 3, axis=1)
    red = np.array([[200, 0, 0]], dtype=np.uint8)
    palette = palette_of(np.concatenate([np.repeat(grey, 4, axis=0), red]))
    assert len(palette) == 251  # room for all
    many = np.stack(np.meshgrid(*[np.arange(0, 250, 25)] * 3), axis=-1).reshape(-1, 3)
    palette = palette_of(np.concatenate([np.repeat(grey[:90], 4, axis=0), many.astype(np.uint8)]))
    assert len(palette) == 256
    chosen = {tuple(color) for color in palette.tolist()}
    assert {tuple(color) for color in grey[:90].tolist()} <= chosen
    assert {(225, 0, 0), (0, 225, 0), (225, 225, 225)} <= chosen


@pytest.mark.parametrize(("across", "along"), [(20.0, 0.0), (3.0, 3.0), (0.0, 20.0)])
def test_legend_is_below_the_axis(across, along):
    """Whatever the shape of the map."""
    views = [
        view(0.0, person(1, 0, 0, coasting=True), truth=np.array([[0.0, 0.0]])),
        view(1.0, person(1, across, along), truth=np.array([[0.0, 0.0]])),
    ]
    away = group_of(views[0].people[0], stragglers={1: 3.0})
    unseen = {"visible": np.array([False]), "groups": [away]}
    film = _Film([dataclasses.replace(views[0], **unseen), views[1]])
    film.draw(0)
    figure = film._figure
    legend, axes = figure.legends[0], figure.axes[0]
    assert len(legend.get_texts()) == 6
    box, axis = legend.get_window_extent(), axes.xaxis.get_tightbbox()
    assert axis is not None
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width
    assert box.y0 >= 0
    assert box.y1 <= axis.y0 + 1


def test_pixels_get_the_nearest_colour():
    palette = np.array([[0, 0, 0], [255, 255, 255], [200, 0, 0]], dtype=np.uint8)
    picture = np.array([[[3, 2, 1], [250, 250, 255]], [[180, 20, 10], [0, 0, 0]]], dtype=np.uint8)
    np.testing.assert_array_equal(nearest(palette, picture), [[0, 1], [2, 0]])


def test_silent_robot_stays_in_the_picture(tmp_path):
    """Its colour does not depend on the other robots."""

    def last_picture(views: list[TopView]) -> np.ndarray:
        animate(views, tmp_path / "film.gif")
        return pictures_of(tmp_path / "film.gif")[-1]

    views = [view(s, person(1, 3, 1)) for s in (0.0, 0.2, 0.4)]
    stood = {**views[1].robots}
    both = [*views[:2], dataclasses.replace(views[2], robots=stood)]
    one = [*views[:2], dataclasses.replace(views[2], robots={"robot_b": stood["robot_b"]})]
    np.testing.assert_array_equal(last_picture(one), last_picture(both))


def test_nothing_to_draw_is_an_error(tmp_path):
    with pytest.raises(PeopleLocError, match="no interval to draw"):
        animate([], tmp_path / "film.gif")
    with pytest.raises(PeopleLocError, match="cannot be written"):
        animate([view(0.0, person(1, 0, 0))], tmp_path / "nowhere" / "film.gif")


@pytest.mark.slow
def test_command(tmp_path):
    film = tmp_path / "film.gif"
    result = CliRunner().invoke(app, ["plot", str(FORMATION), "--animation", str(film)])
    assert result.exit_code == 0, result.output
    assert len(pictures_of(film)) == 15  # 3 s
    assert list(tmp_path.iterdir()) == [film]


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [([], 2, "what is to be drawn"), (["--animation", "film.mp4"], 1, "is a .gif")],
)
def test_command_needs_something_to_draw(options, code, message):
    result = CliRunner().invoke(app, ["plot", str(FORMATION), *options])
    assert result.exit_code == code
    assert message in result.stderr
