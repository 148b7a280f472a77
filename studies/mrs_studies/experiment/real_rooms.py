"""Recordings of real rooms: run, scored against their hand labels, as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_sim.common import number, one_thread
from mrs_people_sim.evaluation.labels import SUFFIX, Labels, labels_beside, name_of, read_labels
from mrs_people_sim.evaluation.results import Result, evaluate_bag
from mrs_people_sim.scoring.positions import CHI2_95, Frame, score, summary
from mrs_studies.experiment.suite_report import table
from mrs_tools.bags.sources import file_beside

_HEAD = (
    "recording",
    "must",
    "found",
    "false",
    "recall",
    "precision",
    "mean [cm]",
    "in 95 %",
    "MODA",
    "MODP",
    "frames without a false person",
)
#: Ranges that are told apart end here [m].
_RANGES_M = (2.5, 3.5, 5.0)


@dataclass(frozen=True)
class Recording:
    """A bag with its labels.

    Attributes:
        name: Name of the bag.
        bag: The bag.
        labels: Its labels.
    """

    name: str
    bag: Path
    labels: Labels


@dataclass(frozen=True)
class Score:
    """Scores of one recording, or of several pooled.

    Attributes:
        result: Against the places of the heads.
        trunk: The frames, against the axes of the trunks.
    """

    result: Result = field(default_factory=Result)
    trunk: list[Frame] = field(default_factory=list)

    @property
    def along(self) -> Float:
        """Of people found, range, error along the line of sight and squared Mahalanobis distance.

        As seen from the origin of the map, where the robots of the recordings stand, against the
        trunk; errors are positive where people were found too far away.

        Returns:
            Ranges and errors [m], shape (n, 3).
        """
        rows = [np.empty((0, 3))]
        for frame in self.trunk:
            if frame.estimate is not None:
                one, other = frame.pairs.T
                found, true = self.result.estimates[frame.estimate].positions, frame.true
                away = np.hypot(*true[other].T)
                errors = ((found[one] - true[other]) * true[other]).sum(axis=1) / away
                rows.append(np.column_stack([away, errors, frame.mahalanobis]))
        return np.concatenate(rows)

    @classmethod
    def pooled(cls, scores: Sequence[Score]) -> Score:
        """Several as one."""
        frames = [frame for one in scores for frame in one.trunk]
        return cls(Result.pooled([one.result for one in scores]), frames)

    def report(self) -> dict[str, Any]:
        """The figures as in the JSON of `mrs evaluate`; `trunk` is `people` against the trunks."""
        return {**self.result.report(), "trunk": summary(self.trunk)["people"]}


@dataclass(frozen=True)
class Scores:
    """All recordings.

    Attributes:
        follow: By recording, whether people can be followed in it.
        followed: By recording, with people followed.
        intervals: By recording, interval by interval.
        paper: By recording, with the paper's method.
    """

    follow: Mapping[str, bool]
    followed: Mapping[str, Score]
    intervals: Mapping[str, Score]
    paper: Mapping[str, Score]

    def default(self) -> dict[str, Score]:
        """By recording, as its labels ask for: followed where that is possible."""
        return {
            name: (self.followed if follow else self.intervals)[name]
            for name, follow in self.follow.items()
        }


def find_recordings(folder: Path, labels: Path) -> tuple[list[Recording], list[str]]:
    """The labelled bags of a folder.

    Args:
        folder: Bags, with a parameter file beside each that has its mounting.
        labels: Folder of label files, for bags that have none beside them.

    Returns:
        The recordings by name, and a line for each that is missing or left out.

    Raises:
        BagError: There is none, or a label file is wrong.
    """
    if not folder.is_dir():
        raise BagError(f"{folder} is no folder; wanted: one with bags of real rooms")
    known = {path.name.removesuffix(SUFFIX): path for path in sorted(labels.glob(f"*{SUFFIX}"))}
    bags = {
        name_of(path): path
        for path in sorted(folder.iterdir())
        if path.suffix == ".mcap" or (path / "metadata.yaml").is_file()
    }
    found, lines = [], []
    for name in sorted({*known, *bags}):
        if name not in bags:
            lines.append(f"{name}: missing, {folder} has no such bag")
            continue
        own = labels_beside(bags[name]) or (read_labels(known[name]) if name in known else None)
        if own is None:
            lines.append(f"{name}: left out, it has no {name}{SUFFIX} beside it or in {labels}")
        elif file_beside(bags[name]) is None:
            lines.append(f"{name}: left out, {name}.yaml with its mounting is not beside it")
        else:
            found.append(Recording(name, bags[name], own))
    if not found:
        raise BagError("; ".join([f"{folder} has no labelled recording", *lines]))
    return found, lines


def run_recordings(
    recordings: Sequence[Recording],
    *,
    paper: Path,
    on_progress: Callable[[str, float], None] = lambda what, share: None,
) -> Scores:
    """Runs recordings with the default and the paper's method.

    Args:
        recordings: The recordings.
        paper: The paper's parameters.
        on_progress: Called with what is done and the share of it, 0 to 1.

    Raises:
        PeopleLocError: A bag cannot be read, or does not fit its labels.
    """

    def run(what: str, configs: Sequence[Path], tracking: bool | None) -> dict[str, Score]:
        scores = {}
        for index, one in enumerate(recordings, 1):
            result = evaluate_bag(one.bag, configs, labels=one.labels, tracking=tracking)
            trunk = score(one.labels.truth(trunk=True), result.estimates)
            scores[one.name] = Score(result, trunk)
            on_progress(what, index / len(recordings))
        return scores

    with one_thread():
        return Scores(
            {one.name: one.labels.follow for one in recordings},
            followed=run("followed", (), True),
            intervals=run("interval by interval", (), False),
            paper=run("paper.yaml", (paper,), None),
        )


def as_json(scores: Scores) -> dict[str, Any]:
    """The figures: by recording, and of all.

    Returns:
        `recordings.NAME.followed` and `.intervals`, each a `Score.report()`, `.paper` likewise,
        and `.table`, which of the first two the table has; `by_range` of these; `total.default` and
        `total.paper`.
    """
    return {
        "recordings": {
            name: {
                "table": "followed" if follow else "intervals",
                "followed": scores.followed[name].report(),
                "intervals": scores.intervals[name].report(),
                "paper": scores.paper[name].report(),
            }
            for name, follow in scores.follow.items()
        },
        "by_range": [
            dict(zip(("up_to_m", "found", "mean_error_along_m", "coverage_95"), row, strict=True))
            for row in _by_range(scores)
        ],
        "total": {
            "default": Score.pooled(list(scores.default().values())).report(),
            "paper": Score.pooled(list(scores.paper.values())).report(),
        },
    }


def markdown(scores: Scores) -> str:
    """The figures as tables in Markdown."""
    default = scores.default()
    rows = [
        *([name, *_figures(one)] for name, one in default.items()),
        ["**all**", *_figures(Score.pooled(list(default.values())))],
        ["all, paper.yaml", *_figures(Score.pooled(list(scores.paper.values())))],
    ]
    both = [
        [name, *map("{} ({})".format, _counts(one), _counts(scores.intervals[name]))]
        for name, one in scores.followed.items()
    ]
    single = ", ".join(name for name, follow in scores.follow.items() if not follow)
    lines = [
        "## Results",
        "",
        "Errors and coverage are against the head; in brackets against the trunk."
        + (f" {single}: interval by interval, the others followed." if single else ""),
        "",
        *table(_HEAD, rows),
        "",
        "## By range",
        "",
        "Against the trunk; errors along the line of sight are positive where people are found too "
        "far away.",
        "",
        *table(
            ("up to [m]", "found", "mean error along [cm]", "in 95 %"),
            [
                [f"{most:g}", str(count), number(along, 100, 1), number(share, 1, 3)]
                for most, count, along, share in _by_range(scores)
            ],
        ),
        "",
        "## Followed, and interval by interval",
        "",
        "With default.yaml and people followed; in brackets each interval by itself.",
        "",
        *table((_HEAD[0], *_HEAD[2:6], _HEAD[-1]), both),
    ]
    return "\n".join(lines) + "\n"


def _by_range(scores: Scores) -> list[tuple[float, int, float | None, float | None]]:
    """By range, people found, their mean error along the line of sight [m], and coverage."""
    along = np.concatenate([one.along for one in scores.default().values()])
    bins, rows = np.searchsorted(_RANGES_M, along[:, 0]), []
    for row, most in enumerate(_RANGES_M):
        _, errors, squares = along[bins == row].T
        known = len(errors) > 0
        share = float((squares <= CHI2_95).mean()) if known else None
        rows.append((most, len(errors), float(errors.mean()) if known else None, share))
    return rows


def _figures(one: Score) -> list[str]:
    """The row of a recording, without its name."""
    report = one.report()
    people, trunk = report["people"], report["trunk"]
    means = [number(each["error_m"]["mean"], 100, 1) for each in (people, trunk)]
    covered = [number(each["coverage_95"], 1, 3) for each in (people, trunk)]
    *counts, clean = _counts(one)
    return [
        str(people["true"]),
        *counts,
        *(f"{head} ({trunk})" for head, trunk in (means, covered)),
        *(number(people[key], 1, 3) for key in ("moda", "modp")),
        clean,
    ]


def _counts(one: Score) -> list[str]:
    """Found, false, recall, precision, frames without a false person."""
    report = one.result.report()
    people = report["people"]
    return [
        str(people["matched"]),
        str(people["estimates"] - people["matched"]),
        *(number(people[key], 1, 3) for key in ("recall", "precision")),
        f"{people['frames_without_false']} of {report['frames']}",
    ]
