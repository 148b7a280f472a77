"""Trains a network that sees people in a whole image, and what judges windows of it.

    pip install torch onnx onnxruntime
    mrs render-suite train .suite/train
    mrs render-suite train .suite/more --variants 12
    python studies/mrs_studies/train_network.py PICTURES .suite/*/*/

PICTURES holds checkouts of the public repositories in `training/sources.py`. Half of the views are
photographs of people, the others are rooms with people put into them, rooms without people and
renderings of the suite; all are made as small and grey as what a robot's head sees. The whole
image is trained first, by the pixels that show people, then both together, at last with more
renderings. The weights are those before and after that last phase, averaged (Wortsman et al. 2022,
"Model soups"): in renderings nearly as good as the last ones, with furniture as good as those
before.
"""

from __future__ import annotations

import argparse
import copy
import pickle
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import onnx
import torch
from torch import nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from mrs_people_loc.bodies.network import (
    CELL,
    COLUMNS,
    MIDDLE_SIZE,
    MULTIPLE,
    ROWS,
    WINDOW_ACROSS,
    WINDOW_HEIGHTS,
    normalized,
)
from mrs_studies.training import pictures, renderings
from mrs_studies.training.pictures import PERSON, UNKNOWN, Cutout, Picture
from mrs_studies.training.places import asked
from mrs_studies.training.views import HEIGHT, WIDTH, composite, view_of

OUT = Path(__file__).parents[2] / "mrs_people_loc/mrs_people_loc/bodies"
#: Shares of the views that are not renderings by what they are of, over their sum.
SHARES = {
    "composites": 0.24, "indoors": 0.1, "meetings": 0.08, "watched": 0.1, "fashion": 0.05,
    "outlines": 0.08, "rooms": 0.13,
}  # fmt: skip
#: Filters by halving of the image, and in the way back.
FILTERS, BACK = (16, 32, 64, 96, 112), (64, 32)
#: Share of a view that shows people whose cells count twice as much as others.
EVEN = 0.1
#: Features of a cell for windows, and hidden units of what judges them.
FEATURES, HIDDEN = 16, 64
DECAY, DOUBT, BATCH, DROPOUT = 0.05, 0.02, 64, 0.3
#: How much the losses of cells and windows count.
WEIGHTS = (1.0, 0.5)


class Phase(NamedTuple):
    """A phase of the training.

    Attributes:
        steps: So many batches.
        rate: Highest rate of learning.
        windows: Whether windows are judged, too.
        renderings: Their share of the views.
    """

    steps: int
    rate: float
    windows: bool
    renderings: float


PHASES = (
    Phase(16_000, 3e-3, False, 0.22),
    Phase(6_000, 1.5e-3, True, 0.22),
    Phase(3_000, 1e-3, True, 0.36),
)


class Training(NamedTuple):
    """What views are made of.

    Attributes:
        groups: Pictures by what they are of.
        cutouts: People for composites.
    """

    groups: dict[str, list[Picture]]
    cutouts: list[Cutout]


def read(folder: Path, bags: Sequence[Path]) -> Training:
    """All pictures.

    Args:
        folder: Checkouts of the sources.
        bags: Rendered bags with ground truth.

    Raises:
        PeopleLocError: A source is missing.
    """
    at_home = list(pictures.taught(folder))
    fashion = list(pictures.fashion(folder))
    outlines = list(pictures.outlines(folder))
    cutouts = [one for _, one in fashion if one is not None]
    cutouts += [one for _, some in outlines for one in some]
    groups = {
        "rooms": [one for one in at_home if not len(one.people)],
        "indoors": [one for one in at_home if len(one.people)],
        "meetings": list(pictures.meetings(folder)),
        "watched": list(pictures.watched(folder)),
        "fashion": [one for one, _ in fashion],
        "outlines": [one for one, _ in outlines],
        "renderings": [one for bag in bags for one in renderings.pictures_of(bag)],
    }
    return Training(groups, cutouts + list(pictures.windows(folder)))


class Views:
    """Views with what their cells show, each drawn anew."""

    def __init__(self, training: Training, count: int, renderings: float, seed: int) -> None:
        self.training, self.count, self.seed = training, count, seed
        rest = (1.0 - renderings) / sum(SHARES.values())
        self.shares = {"renderings": renderings, **{name: rest * SHARES[name] for name in SHARES}}

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> tuple[Any, Any, Any]:
        rng = np.random.default_rng([self.seed, index])
        groups, cutouts = self.training
        name = rng.choice(list(self.shares), p=list(self.shares.values()))
        if name == "composites":
            picture = composite(groups["rooms"], cutouts, rng)
        else:
            picture = groups[name][rng.integers(len(groups[name]))]
        grey, label, told = view_of(picture, groups["rooms"], rng)
        values, places = normalized(grey), asked(told, label, rng).astype(np.float32)
        padding = [(0, b - a) for a, b in zip(label.shape, values.shape[1:], strict=True)]
        return values, np.pad(label, padding, constant_values=UNKNOWN), places


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """A convolution, normalized over the batch, without what is negative."""
    convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Network(nn.Module):  # type: ignore[misc,unused-ignore]
    """Features of cells: down to 1 / 32 of the image, and back to 1 / 4."""

    def __init__(self) -> None:
        super().__init__()
        a, b, c, d, e = FILTERS
        self.first = block(2, a, 2)
        self.quarter = nn.Sequential(block(a, b, 2), block(b, b))
        self.eighth = nn.Sequential(block(b, c, 2), block(c, c))
        self.sixteenth = nn.Sequential(block(c, d, 2), block(d, d), block(d, d))
        self.last = nn.Sequential(block(d, e, 2), block(e, e), block(e, e))
        wide, narrow = BACK
        self.of_last, self.of_sixteenth = nn.Conv2d(e, wide, 1), nn.Conv2d(d, wide, 1)
        self.of_eighth, self.of_quarter = nn.Conv2d(c, wide, 1), nn.Conv2d(b, narrow, 1)
        self.to_eighth, self.to_quarter = block(wide, wide), block(wide, narrow)
        self.log_odds = nn.Conv2d(narrow, 1, 3, 1, 1)
        self.features = block(narrow, FEATURES)

    def forward(self, image: Any) -> Any:
        """Shape (n, `FEATURES`, height / `CELL`, width / `CELL`)."""
        return self.features(self.back(image))

    def back(self, image: Any) -> Any:
        """What features are made of, and `log_odds`, which helps in training only."""

        def larger(values: Any) -> Any:
            return functional.interpolate(values, scale_factor=2, mode="nearest")

        quarter = self.quarter(self.first(image))
        eighth = self.eighth(quarter)
        sixteenth = self.sixteenth(eighth)
        back = functional.relu(
            self.of_sixteenth(sixteenth) + larger(self.of_last(self.last(sixteenth)))
        )
        back = functional.relu(self.of_eighth(eighth) + larger(self.to_eighth(back)))
        return functional.relu(self.of_quarter(quarter) + larger(self.to_quarter(back)))


class Judge(nn.Sequential):  # type: ignore[misc,unused-ignore]
    """Log-odds that a person stands at the middle of a window, from its `window_input`."""

    def __init__(self) -> None:
        count = ROWS * COLUMNS * (FEATURES + 1) + 1
        first, last = nn.Linear(count, HIDDEN), nn.Linear(HIDDEN, 1)
        super().__init__(nn.Dropout(DROPOUT), first, nn.ReLU(), nn.Dropout(DROPOUT), last)


def windows(features: Any, places: Any) -> Any:
    """As `window_input`, at places of views, shape (n * `COUNT`, inputs).

    Args:
        features: Of the views, shape (n, `FEATURES`, rows, columns).
        places: Shape (n, `COUNT`, 5), as of `asked`.
    """
    foot_u, foot_v, size = places[..., 0], places[..., 1], places[..., 2]
    across, up = torch.from_numpy(WINDOW_ACROSS), torch.from_numpy(WINDOW_HEIGHTS)
    u = foot_u[..., None, None] - size[..., None, None] * across
    v = foot_v[..., None, None] - size[..., None, None] * up[:, None]
    u, v = torch.broadcast_tensors(u, v)
    inside = (u > -0.5) & (u < WIDTH - 0.5) & (v > -0.5) & (v < HEIGHT - 0.5)
    rows, columns = features.shape[2:]
    at = torch.stack(
        [(2 * u + 1) / (CELL * columns) - 1, (2 * v + 1) / (CELL * rows) - 1], dim=-1
    ).flatten(1, 2)
    seen = functional.grid_sample(features, at, padding_mode="border", align_corners=False)
    seen = seen.unflatten(2, (places.shape[1], ROWS)).permute(0, 2, 3, 4, 1)
    mask = inside[..., None].float()
    seen = torch.cat([seen * mask, mask], dim=-1).flatten(2)
    told = torch.log(size / MIDDLE_SIZE)[..., None]
    return torch.cat([seen, told], dim=-1).flatten(0, 1)


def by_cell(label: Any) -> tuple[Any, Any]:
    """Share of each cell that shows a person, and whether enough of it is known."""
    person = functional.avg_pool2d((label == PERSON).float()[:, None], CELL)
    known = functional.avg_pool2d((label != UNKNOWN).float()[:, None], CELL)
    return person / known.clamp(min=1e-3), (known > 0.3).float()


def _weight(share: Any, known: Any) -> Any:
    """How much more the cells of people count: more where little of a view shows people."""
    part = (share * known).mean(dim=(1, 2, 3), keepdim=True)
    return share * (EVEN / part.clamp(min=1e-3)).clamp(0.5, 4.0)


def _map_loss(found: Any, label: Any) -> Any:
    share, known = by_cell(label)
    target = share * (1.0 - 2.0 * DOUBT) + DOUBT
    loss = functional.binary_cross_entropy_with_logits(found, target, reduction="none")
    return (loss * known * (1.0 + _weight(share, known))).sum() / known.sum()


def _window_loss(found: Any, places: Any) -> Any:
    person, known = places[..., 3].flatten(), places[..., 4].flatten()
    target = person * (1.0 - 2.0 * DOUBT) + DOUBT
    loss = functional.binary_cross_entropy_with_logits(found, target, reduction="none")
    count = (known * person).sum(), (known * (1.0 - person)).sum()
    weight = known * torch.where(person > 0.5, 0.5 / count[0], 0.5 / count[1])  # both count alike
    return (loss * weight).sum()


def train(training: Training, phases: Sequence[Phase], seed: int) -> tuple[Network, Judge]:
    """Both networks, averaged over the last two phases."""
    both: Any = nn.ModuleList([Network(), Judge()]).to(memory_format=torch.channels_last)
    made = []
    for number, phase in enumerate(phases):
        views = Views(training, BATCH * phase.steps, phase.renderings, seed + number)
        both = _trained(both, views, phase)
        made.append(both)
    average = torch.optim.swa_utils.AveragedModel(made[-2], use_buffers=True)
    for one in made[-2:]:
        average.update_parameters(one)
    network, judge = average.module.eval()
    return network, judge


def _trained(both: Any, views: Any, phase: Phase) -> Any:
    """Networks trained on, averaged over the last steps."""
    both, rate, steps = copy.deepcopy(both), phase.rate, phase.steps
    loader: Any = torch.utils.data.DataLoader(views, BATCH, num_workers=2, prefetch_factor=4)
    mean = torch.optim.swa_utils.get_ema_multi_avg_fn(0.998)
    average = torch.optim.swa_utils.AveragedModel(both, multi_avg_fn=mean, use_buffers=True)
    optimizer = torch.optim.AdamW(both.parameters(), rate, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, steps)
    totals, start = np.zeros(2), time.monotonic()
    network, judge = both
    for step, (image, label, places) in enumerate(loader, 1):
        with torch.autocast("cpu", torch.bfloat16):
            back = network.back(image.to(memory_format=torch.channels_last))
            log_odds, features = network.log_odds(back), network.features(back)
        losses = [_map_loss(log_odds.float(), label)]
        if phase.windows:
            found = judge(windows(features.float(), places))[:, 0]
            losses.append(_window_loss(found, places))
        optimizer.zero_grad()
        sum(weight * loss for weight, loss in zip(WEIGHTS, losses, strict=False)).backward()
        optimizer.step()
        schedule.step()
        average.update_parameters(both)
        totals[: len(losses)] += [loss.item() for loss in losses]
        if step % 100 == 0:
            shown = " ".join(f"{total / 100:.4f}" for total in totals)
            print(f"{step}: losses {shown}, {time.monotonic() - start:.0f} s", flush=True)
            totals[:] = 0.0
    return average.module


def save(network: Network, judge: Judge, folder: Path) -> None:
    """Writes both as ONNX that OpenCV 4.6 reads, batch norms merged into convolutions."""
    parts: Any = network.modules()
    for part in parts:
        if isinstance(part, nn.Sequential) and isinstance(part[1], nn.BatchNorm2d):
            convolution: Any = part[0]
            part[0], part[1] = fuse_conv_bn_eval(convolution, part[1]), nn.Identity()
    image = torch.zeros(1, 2, MULTIPLE, MULTIPLE)
    _export(network, image, {2: "height", 3: "width"}, folder / "person_features.onnx")
    window = torch.zeros(1, judge[1].in_features)
    _export(judge, window, {0: "windows"}, folder / "person_window.onnx")


def _export(network: Any, example: Any, free: dict[int, str], path: Path) -> None:
    """Writes a network whose named sides are free."""
    torch.onnx.export(
        network,
        (example,),
        str(path),
        opset_version=11,
        dynamo=False,
        input_names=["input"],
        output_names=["output"],
        dynamic_axes={"input": free, "output": free},
    )
    onnx.checker.check_model(onnx.load(str(path)))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("pictures", type=Path, help="folder of the sources' checkouts")
    parser.add_argument("bags", type=Path, nargs="+", help="bags of `mrs render-suite train`")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, help="file that keeps what was read")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of both networks")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    torch.manual_seed(options.seed)
    if options.cache and options.cache.exists():
        training: Training = pickle.loads(options.cache.read_bytes())
    else:
        training = read(options.pictures, options.bags)
        if options.cache:
            options.cache.write_bytes(pickle.dumps(training))
    for name, group in training.groups.items():
        boxes = sum(len(one.people) for one in group)
        print(f"{name}: {len(group)} pictures, {boxes} people")
    print(f"{len(training.cutouts)} people to put into rooms")
    save(*train(training, PHASES, options.seed), options.out)


if __name__ == "__main__":
    main()
