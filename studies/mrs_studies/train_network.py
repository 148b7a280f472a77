"""Trains the network that recognizes people, `bodies/person_network.onnx`.

    mrs render-suite train .suite/train
    pip install torch onnx
    python studies/mrs_studies/train_network.py .suite/train/*/

Examples are the candidates of the body finder in simulated bags with ground truth, at their axes,
and places where nobody is. Simulated images are cleaner than those of real rooms, so each example
is distorted again in each epoch: position, size, light, blur, noise, edges of the image, and pieces
of other examples in front of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn
from torch.nn import functional

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.bodies.finder import BodyFinder
from mrs_people_loc.bodies.network import COLUMNS, ROWS, normalized, sample_windows
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes
from mrs_studies.fitting.examples import _at, _true_poses
from mrs_tools.bags.offline import BagRun

OUT = Path(__file__).parents[2] / "mrs_people_loc/mrs_people_loc/bodies/person_network.onnx"
#: A person is at a place within this across and along [m], [m], [px], at most [m]; nobody beyond
#: twice that.
ACROSS, ALONG, ALONG_PX, ALONG_MOST = 0.25, 0.3, 0.7, 0.8
#: Another robot likewise [m].
ROBOT = 0.5
#: Places without a candidate in each view, within these ranges [m] and this far from people [m].
PLACES, NEAREST, FARTHEST, APART = 10, 0.7, 5.5, 0.4
#: Views of each robot and bag.
VIEWS = 24
#: Filters of the layers, and their strides; share of the weights' decay; least doubt of a label.
LAYERS = ((2, 16, 2), (16, 16, 1), (16, 32, 2), (32, 32, 1), (32, 64, 2))
LEFT = (ROWS // 8) * (COLUMNS // 8) * LAYERS[-1][1]
RATE, DECAY, DOUBT, BATCH = 4e-3, 0.05, 0.03, 128


class Finder(BodyFinder):
    """Keeps every candidate."""

    def _alone(self, bodies: Any) -> Int:
        return np.arange(len(bodies))


class Looker:
    """A robot's pipeline up to the candidates; keeps views: stamp, left image, bodies."""

    def __init__(self, robot: str, camera: StereoCamera, config: RobotConfig) -> None:
        self.robot, self.camera = robot, camera
        self._match = StereoMatcher(camera, config.disparity)
        self._find = Finder(camera, config.bodies, min_range=config.disparity.min_range)
        self.views: list[tuple[int, Any, Any]] = []

    def stages(self, images: StereoImages) -> ScanStages:
        """Looks at one view."""
        disparity = self._match(images)
        bodies = self._find(disparity, images, StageTimes())
        self.views.append((images.stamp_ns, images.left, bodies))
        return ScanStages(disparity, Scan(self.robot, images.stamp_ns, Cells.empty()), {})


def examples_of(path: Path, rng: np.random.Generator) -> tuple[list[Any], list[Any]]:
    """Windows with masks (n, 2, rows, columns), and who is a person (n,), of each view of a bag."""
    lookers: list[Looker] = []

    def make(robot: str, camera: StereoCamera, config: RobotConfig) -> Looker:
        lookers.append(Looker(robot, camera, config))
        return lookers[-1]

    run = BagRun(path, pipeline=make)
    truth = run.truth()
    for _ in run.intervals():
        pass
    poses = _true_poses(path, [looker.robot for looker in lookers])
    windows, people = [], []
    for looker in lookers:
        count = len(looker.views)
        for k in np.unique(np.linspace(0, count - 1, min(count, VIEWS)).round().astype(int)):
            stamp_ns, left, bodies = looker.views[k]
            at = {name: _at(track, stamp_ns) for name, track in poses.items()}
            others = np.array([at[n][:2] for n in at if n != looker.robot]).reshape(-1, 2)
            xy, _ = truth.at(stamp_ns)
            places = label(
                looker.camera, bodies, at[looker.robot], xy[np.isfinite(xy[:, 0])], others, rng
            )
            grey, inside = sample_windows(looker.camera, left, *places[:2])
            windows.append(np.stack([grey, 255.0 * inside], axis=1).astype(np.uint8))
            people.append(places[2])
    return windows, people


def label(
    camera: StereoCamera,
    bodies: Any,
    pose: Float,
    people: Float,
    others: Float,
    rng: np.random.Generator,
) -> tuple[Float, Float, Bool]:
    """Bearings [rad] and ranges [m] of places in a view, and whether a person is there."""
    rotation, lens = camera.robot_from_optical
    ahead = np.arctan2(rotation[1, 2], rotation[0, 2])
    half = np.arctan(0.5 * camera.width / camera.fx)
    bearing = np.append(bodies.bearing, ahead + rng.uniform(-half, half, PLACES))
    ranges = np.append(bodies.range, np.exp(rng.uniform(np.log(NEAREST), np.log(FARTHEST), PLACES)))
    candidate = np.arange(len(bearing)) < len(bodies)

    def seen(places: Float) -> tuple[Float, Float, Float]:
        local = (places - pose[:2]) @ rotation_2d(pose[2]) - lens[:2]
        far, at = np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0])
        turn = np.angle(np.exp(1j * (at - bearing[:, np.newaxis])))
        return far * np.sin(turn), far * np.cos(turn) - ranges[:, np.newaxis], far

    across, along, far = seen(people)
    allowed = np.minimum(ALONG + ALONG_PX * far**2 / camera.depth_disparity, ALONG_MOST)
    away = np.hypot(across / ACROSS, along / allowed).min(axis=1, initial=np.inf)
    aside = np.abs(across).min(axis=1, initial=np.inf)
    other_across, other_along, _ = seen(others)
    robot = (np.hypot(other_across, other_along) < ROBOT).any(axis=1)
    person = candidate & (away < 1.0)
    used = person | (~robot & np.where(candidate, away >= 2.0, aside > APART))
    return bearing[used], ranges[used], person[used]


def distorted(x: Any, other: Any) -> Any:
    """Distorted windows with masks, in float, shape (n, 2, rows, columns).

    Args:
        x: Windows with masks, likewise.
        other: Which show no person and may stand in front of others, shape (n,).
    """
    n = len(x)

    def some(low: float, high: float) -> Any:
        return low + (high - low) * torch.rand(n, 1, 1)

    move = torch.zeros(n, 2, 3)
    move[:, 0, 0] = some(0.88, 1.12)[:, 0, 0] * torch.where(torch.rand(n) < 0.5, -1.0, 1.0)
    move[:, 1, 1] = some(0.92, 1.08)[:, 0, 0]
    move[:, 0, 1] = some(-0.06, 0.06)[:, 0, 0]
    move[:, 0, 2], move[:, 1, 2] = some(-0.16, 0.16)[:, 0, 0], some(-0.08, 0.08)[:, 0, 0]
    grid = functional.affine_grid(move, list(x.shape), align_corners=False)
    grey = functional.grid_sample(x[:, :1], grid, padding_mode="border", align_corners=False)[:, 0]
    mask = functional.grid_sample(x[:, 1:], grid, align_corners=False)[:, 0]
    row, column = torch.arange(float(ROWS))[:, None], torch.arange(float(COLUMNS))
    # Pieces of others in front of the lower part or one side.
    from_ = torch.randperm(n)
    kind = torch.rand(n, 1, 1)
    piece = (kind < 0.2) & (row > some(20, 48)).expand(n, ROWS, COLUMNS)
    piece |= (kind > 0.2) & (kind < 0.25) & (column < some(2, 9))
    piece |= (kind > 0.25) & (kind < 0.3) & (column > some(14, 21))
    grey = torch.where(piece & other[from_][:, None, None], grey[from_], grey)
    # Edges of the image.
    kind = torch.rand(n, 1, 1)
    cut = (kind < 0.12) & (column < some(2, 12)) | (kind > 0.88) & (column > some(11, 21))
    cut = cut.expand(n, ROWS, COLUMNS)
    cut = cut | (kind > 0.3) & (kind < 0.5) & (row > some(20, 46))
    cut = cut | (kind > 0.5) & (kind < 0.58) & (row < some(1, 11))
    return torch.stack([_in_other_light(grey, row, column, some), mask * ~cut], dim=1)


def _in_other_light(grey: Any, row: Any, column: Any, some: Any) -> Any:
    """Blur, gamma, contrast, brightness, gradients of light and noise."""
    kernel = torch.tensor([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
    for along, share in (("across", 0.4), ("down", 0.2)):
        weights = kernel.view((1, 1, 1, 5) if along == "across" else (1, 1, 5, 1))
        pad = (2, 2, 0, 0) if along == "across" else (0, 0, 2, 2)
        padded = functional.pad(grey[:, None], pad, "replicate")
        grey = torch.where(some(0, 1) < share, functional.conv2d(padded, weights)[:, 0], grey)
    grey = 255.0 * (grey.clamp(0, 255) / 255.0) ** torch.exp(some(-0.6, 0.6))
    middle = grey.mean(dim=(1, 2), keepdim=True)
    grey = middle + (grey - middle) * torch.exp(some(-0.9, 0.9)) + some(-40, 40)
    light = some(-0.4, 0.4) * (row / (ROWS / 2) - 1) + some(-0.4, 0.4) * (
        column / (COLUMNS / 2) - 1
    )
    grey = grey.clamp(0, 255) * (1.0 + light)
    return (grey + torch.randn(grey.shape) * 8.0 * some(0, 1) ** 2).clamp(0, 255)


def network_input(x: Any) -> Any:
    """The input of windows with masks: what the robot's own code makes of them."""
    values = x.numpy()
    return torch.from_numpy(normalized(values[:, 0], values[:, 1] > 127.0))


def train(windows: Any, person: Any, epochs: int) -> nn.Sequential:
    """The network, averaged over the last steps."""
    parts: list[nn.Module] = []
    for inputs, outputs, stride in LAYERS:
        convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        parts += [convolution, nn.BatchNorm2d(outputs), nn.ReLU()]
    network = nn.Sequential(*parts, nn.Flatten(), nn.Dropout(0.5), nn.Linear(LEFT, 1))
    mean = torch.optim.swa_utils.get_ema_multi_avg_fn(0.995)
    average = torch.optim.swa_utils.AveragedModel(network, multi_avg_fn=mean, use_buffers=True)
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=DECAY)
    steps = len(windows) // BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, epochs * steps)
    weight = person.mean() / (1.0 - person.mean())  # both kinds count alike
    for epoch in range(epochs):
        order, total = torch.randperm(len(windows)), 0.0
        for k in range(steps):
            chosen = order[k * BATCH : (k + 1) * BATCH]
            y = person[chosen]
            x = network_input(distorted(windows[chosen].float(), y < 0.5))
            target = y * (1.0 - 2.0 * DOUBT) + DOUBT
            loss = functional.binary_cross_entropy_with_logits(
                network(x)[:, 0], target, torch.where(y > 0.5, 1.0, weight)
            )
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            average.update_parameters(network)
            total += loss.item()
        print(f"epoch {epoch + 1}: loss {total / steps:.3f}", flush=True)
    average.eval()
    return average.module


def save(network: nn.Sequential, path: Path) -> None:
    """Writes the network as ONNX that OpenCV 4.6 reads, batch norms merged into convolutions."""
    nodes, weights, name = [], [], "windows"

    def constant(key: str, value: Any) -> str:
        weights.append(numpy_helper.from_array(value.detach().numpy().copy(), key))
        return key

    layers: list[Any] = list(network)
    for k, (_, _, stride) in enumerate(LAYERS):
        convolution, norm = layers[3 * k : 3 * k + 2]
        scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        inputs = [
            name,
            constant(f"weights{k}", convolution.weight * scale[:, None, None, None]),
            constant(f"bias{k}", norm.bias - norm.running_mean * scale),
        ]
        options = {"kernel_shape": [3, 3], "strides": [stride] * 2, "pads": [1] * 4}
        nodes.append(helper.make_node("Conv", inputs, [f"conv{k}"], **options))
        nodes.append(helper.make_node("Relu", [f"conv{k}"], [name := f"relu{k}"]))
    last = [constant("weights", layers[-1].weight), constant("bias", layers[-1].bias)]
    nodes.append(helper.make_node("Flatten", [name], ["flat"], axis=1))
    nodes.append(helper.make_node("Gemm", ["flat", *last], ["log_odds"], transB=1))
    shape = ["n", LAYERS[0][0], ROWS, COLUMNS]
    graph = helper.make_graph(
        nodes,
        "person_network",
        [helper.make_tensor_value_info("windows", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("log_odds", TensorProto.FLOAT, ["n", 1])],
        weights,
    )
    opset = [helper.make_opsetid("", 11)]
    model = helper.make_model(graph, opset_imports=opset, ir_version=6)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("bags", type=Path, nargs="+", help="bags of `mrs simulate`")
    parser.add_argument("--epochs", type=int, default=14)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    rng = np.random.default_rng(options.seed)
    windows, people = [], []
    for bag in options.bags:
        some_windows, some_people = examples_of(bag, rng)
        windows += some_windows
        people += some_people
    person = np.concatenate(people)
    print(f"{person.sum()} examples of people, {(~person).sum()} of other things")
    network = train(
        torch.from_numpy(np.concatenate(windows)),
        torch.from_numpy(person.astype(np.float32)),
        options.epochs,
    )
    save(network, options.out)


if __name__ == "__main__":
    main()
