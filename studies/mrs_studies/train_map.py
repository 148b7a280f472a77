r"""Trains a network that sees where people are in a whole image, on photographs.

    pip install torch onnx onnxruntime
    mrs render-suite train .suite/train
    mrs render-suite train .suite/more --variants 12
    python studies/mrs_studies/train_map.py PICTURES .suite/*/*/ --out person_map.onnx \
        --real RECORDINGS

PICTURES holds checkouts of the public repositories in `training/sources.py`. Half of the views are
photographs of people, the others are rooms with people put into them, rooms without people and
renderings of the suite; all are made as small and grey as what a robot's head sees. With --real,
the network is judged on labelled recordings, of which it has seen nothing.
"""

from __future__ import annotations

import argparse
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

from mrs_people_loc.bodies.patches import PatchSampler
from mrs_people_loc.bodies.person_map import CELL, MULTIPLE, PersonMap, normalized
from mrs_studies import LABELS
from mrs_studies.experiment.real_rooms import find_recordings
from mrs_studies.training import pictures, renderings
from mrs_studies.training.pictures import PERSON, UNKNOWN, Cutout, Picture
from mrs_studies.training.renderings import lookers_of
from mrs_studies.training.views import composite, view_of

#: Share of the views by what they are of.
SHARES = {
    "composites": 0.24, "indoors": 0.1, "meetings": 0.08, "watched": 0.1, "fashion": 0.05,
    "outlines": 0.08, "renderings": 0.22, "rooms": 0.13,
}  # fmt: skip
#: Filters by halving of the image, and in the way back.
FILTERS, BACK = (16, 32, 64, 96, 112), (64, 32)
#: Share of a view that shows people whose cells count twice as much as others.
EVEN = 0.1
RATE, DECAY, DOUBT, BATCH = 3e-3, 0.05, 0.02, 64


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

    def __init__(self, training: Training, count: int, seed: int) -> None:
        self.training, self.count, self.seed = training, count, seed

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> tuple[Any, Any]:
        rng = np.random.default_rng([self.seed, index])
        groups, cutouts = self.training
        name = rng.choice(list(SHARES), p=list(SHARES.values()))
        if name == "composites":
            picture = composite(groups["rooms"], cutouts, rng)
        else:
            picture = groups[name][rng.integers(len(groups[name]))]
        grey, label = view_of(picture, groups["rooms"], rng)
        values = normalized(grey)
        padding = [(0, b - a) for a, b in zip(label.shape, values.shape[1:], strict=True)]
        return values, np.pad(label, padding, constant_values=UNKNOWN)


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """A convolution, normalized over the batch, without what is negative."""
    convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Network(nn.Module):  # type: ignore[misc,unused-ignore]
    """Log-odds of a person by cell: down to 1 / 32 of the image, and back to 1 / 4."""

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

    def forward(self, image: Any) -> Any:
        """Shape (n, 1, height / `CELL`, width / `CELL`)."""

        def larger(values: Any) -> Any:
            return functional.interpolate(values, scale_factor=2, mode="nearest")

        quarter = self.quarter(self.first(image))
        eighth = self.eighth(quarter)
        sixteenth = self.sixteenth(eighth)
        back = functional.relu(
            self.of_sixteenth(sixteenth) + larger(self.of_last(self.last(sixteenth)))
        )
        back = functional.relu(self.of_eighth(eighth) + larger(self.to_eighth(back)))
        back = functional.relu(self.of_quarter(quarter) + larger(self.to_quarter(back)))
        return self.log_odds(back)


def by_cell(label: Any) -> tuple[Any, Any]:
    """Share of each cell that shows a person, and whether enough of it is known."""
    person = functional.avg_pool2d((label == PERSON).float()[:, None], CELL)
    known = functional.avg_pool2d((label != UNKNOWN).float()[:, None], CELL)
    return person / known.clamp(min=1e-3), (known > 0.3).float()


def _weight(share: Any, known: Any) -> Any:
    """How much more the cells of people count: more where little of a view shows people."""
    part = (share * known).mean(dim=(1, 2, 3), keepdim=True)
    return share * (EVEN / part.clamp(min=1e-3)).clamp(0.5, 4.0)


def train(training: Training, steps: int, seed: int) -> nn.Module:
    """The network, averaged over the last steps."""
    views: Any = Views(training, BATCH * steps, seed)
    loader: Any = torch.utils.data.DataLoader(views, BATCH, num_workers=2, prefetch_factor=4)
    network: Any = Network().to(memory_format=torch.channels_last)
    mean = torch.optim.swa_utils.get_ema_multi_avg_fn(0.998)
    average = torch.optim.swa_utils.AveragedModel(network, multi_avg_fn=mean, use_buffers=True)
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps)
    total, start = 0.0, time.monotonic()
    for step, (image, label) in enumerate(loader, 1):
        share, known = by_cell(label)
        with torch.autocast("cpu", torch.bfloat16):
            found = network(image.to(memory_format=torch.channels_last))
        target = share * (1.0 - 2.0 * DOUBT) + DOUBT
        loss = functional.binary_cross_entropy_with_logits(found.float(), target, reduction="none")
        loss = (loss * known * (1.0 + _weight(share, known))).sum() / known.sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        average.update_parameters(network)
        total += loss.item()
        if step % 100 == 0:
            print(f"{step}: loss {total / 100:.4f}, {time.monotonic() - start:.0f} s", flush=True)
            total = 0.0
    return average.module.eval()


def save(network: nn.Module, path: Path) -> None:
    """Writes the network as ONNX that OpenCV 4.6 reads, batch norms merged into convolutions."""
    parts: Any = network.modules()
    for part in parts:
        if isinstance(part, nn.Sequential) and isinstance(part[1], nn.BatchNorm2d):
            convolution: Any = part[0]
            part[0], part[1] = fuse_conv_bn_eval(convolution, part[1]), nn.Identity()
    sides = {2: "height", 3: "width"}
    torch.onnx.export(
        network,
        (torch.zeros(1, 2, MULTIPLE, MULTIPLE),),
        str(path),
        opset_version=11,
        dynamo=False,
        input_names=["image"],
        output_names=["log_odds"],
        dynamic_axes={"image": sides, "log_odds": {2: "rows", 3: "columns"}},
    )
    onnx.checker.check_model(onnx.load(str(path)))


def judged(network: Path, folder: Path) -> list[str]:
    """By labelled recording: how many people who must be found the map sees.

    Beside it, the share of the cells in which it sees somebody, of views without anybody.

    Args:
        network: As `save` writes it.
        folder: The recordings.
    """
    lines = []
    for one in find_recordings(folder, LABELS)[0]:
        truth, seen, cells = one.labels.truth(trunk=True), [], []
        for looker in lookers_of(one.bag):
            person_map, sample = PersonMap(looker.camera, network), PatchSampler(looker.camera)
            _, lens = looker.camera.robot_from_optical
            for stamp_ns, left in looker.views:
                people, must = truth.at(stamp_ns)
                ahead, aside = (people[must] - lens[:2]).T
                inverse = looker.camera.depth_disparity / np.hypot(ahead, aside)
                patches = sample(
                    np.full(left.shape, np.nan, np.float32), np.arctan2(aside, ahead), inverse
                )
                seen += (person_map(left, patches) > 0).tolist()
                if not len(people):
                    cells.append((person_map.log_odds(left) > 0).mean())
        false = f"{100 * np.mean(cells):.1f} % of the cells of {len(cells)}" if cells else "none"
        lines.append(f"{one.name}: {sum(seen)} of {len(seen)} people; views without: {false}")
    return lines


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("pictures", type=Path, help="folder of the sources' checkouts")
    parser.add_argument("bags", type=Path, nargs="+", help="bags of `mrs render-suite train`")
    parser.add_argument("--steps", type=int, default=16_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, help="file that keeps what was read")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--real", type=Path, help="folder of labelled recordings, as of mrs real")
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
    save(train(training, options.steps, options.seed), options.out)
    if options.real:
        print("\n".join(judged(options.out, options.real)))


if __name__ == "__main__":
    main()
