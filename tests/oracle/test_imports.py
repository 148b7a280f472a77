"""The oracle takes no computation from what it checks."""

import ast
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
MODULES = sorted(
    file
    for file in FOLDER.glob("*.py")
    if not file.name.startswith("test_") and file.stem not in ("comparison", "scenes")
)
#: Types of the core that its modules read.
TYPES = {
    "mrs_people_loc.config": {
        "Bodies", "Disparity", "Human", "Joining", "Masking", "PlannerConfig", "RobotConfig",
        "Splitting", "Tracking",
    },
    "mrs_people_loc.people": {"Group", "Person"},
    "mrs_people_loc.scan": {"Cells", "Scan"},
    "mrs_people_loc.sensing.camera": {"StereoCamera"},
    "mrs_people_loc.sensing.images": {"Gray", "StereoImages"},
    "mrs_people_loc.team.fusion": {"ShortTermMap"},
    "mrs_people_loc.team.masking": {"OccupancyGrid"},
    "mrs_people_loc.team.poses": {"Pose"},
}  # fmt: skip
#: What these types compute: methods and properties that the oracle has to do without.
COMPUTED = {
    "concatenate", "depth_disparity", "disparity_of", "from_mapping", "from_models", "from_records",
    "memoryless", "robot_from_optical", "select", "to_records",
}  # fmt: skip
#: What it may use from elsewhere.
OTHERS = {
    "__future__", "collections", "collections.abc", "cv2", "dataclasses", "functools", "importlib",
    "json", "math", "numpy", "numpy.typing", "typing",
}  # fmt: skip


def imported(tree: ast.AST) -> list[tuple[str, str | None]]:
    """Modules that are imported, and names of them; None: the module itself."""
    found: list[tuple[str, str | None]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level
            found += [(node.module or "", alias.name) for alias in node.names]
    return found


@pytest.mark.parametrize("file", MODULES, ids=lambda file: file.stem)
def test_only_types_and_configuration_are_imported_from_the_packages(file):
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for module, name in imported(tree):
        if module in OTHERS:
            continue
        if module.partition(".")[0] == "oracle":
            assert module.rpartition(".")[2] not in ("comparison", "scenes")
            continue
        assert name in TYPES.get(module, ()), f"{file.name} imports {name} from {module}"
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not used & COMPUTED
    assert not {"import_module", "__import__", "eval", "exec"} & {
        node.id for node in ast.walk(tree) if isinstance(node, ast.Name)
    }


def test_all_modules_of_the_oracle_exist():
    assert len(MODULES) > 15


def test_comparison_runs_nothing_of_the_core_but_bodies_and_a_planner_that_is_recorded():
    tree = ast.parse((FOLDER / "comparison.py").read_text(encoding="utf-8"))
    core = {name for module, name in imported(tree) if (module or "").startswith("mrs_people_loc")}
    called = {
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert core & called == {"BodyFinder", "BodySearch", "Planner", "StageTimes"}


def test_oracle_is_not_shipped():
    root = FOLDER.parents[1]
    for file in ("pyproject.toml", "mrs_people_loc/setup.py", "robot_node/setup.py",
                 "planner_node/setup.py"):  # fmt: skip
        text = (root / file).read_text(encoding="utf-8")
        shipped = text.partition("packages")[2].partition("]")[0]
        assert shipped
        assert "oracle" not in shipped
        assert "tests" not in shipped
