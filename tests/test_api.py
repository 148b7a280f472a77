"""What `import mrs_people_loc` and `import mrs_tools.bags` offer."""

import ast
import importlib.util
import inspect
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import mrs_people_loc
import mrs_ros
import mrs_tools
import mrs_tools.bags

ROOT = Path(__file__).resolve().parents[1]
PACKAGES: tuple[Any, ...] = (mrs_people_loc, mrs_tools.bags)
NAMES = [
    pytest.param(package, name, id=f"{package.__name__}.{name}")
    for package in PACKAGES
    for name in package.__all__
]


@pytest.mark.parametrize(("package", "name"), NAMES)
def test_public_name_says_what_it_is(package: Any, name: str) -> None:
    public = getattr(package, name)
    assert inspect.isclass(public) or inspect.isfunction(public)
    assert public.__name__ == name
    # Not the text that a dataclass without one is given.
    assert public.__doc__
    assert not public.__doc__.startswith(f"{name}(")


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_see_the_same_names(package: Any) -> None:
    """They read the imports that Python itself leaves out."""
    tree = ast.parse(inspect.getsource(package))
    imported = {
        alias.asname: (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
        if alias.asname
    }
    assert sorted(imported) == package.__all__
    for public, (module, name) in imported.items():
        assert public == name
        assert getattr(importlib.import_module(module), name) is getattr(package, public)


@pytest.mark.parametrize("package", [mrs_people_loc, mrs_ros, mrs_tools])
def test_package_has_types_for_its_users(package: Any) -> None:
    """PEP 561: type checkers ignore the annotations of an installed package without this file."""
    assert (Path(inspect.getfile(package)).parent / "py.typed").is_file()


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_listed_before_they_are_asked_for(package: Any) -> None:
    assert {*package.__all__, "__name__"} <= {*dir(package)}


@pytest.mark.parametrize("package", PACKAGES)
def test_unknown_name_is_an_attribute_error(package: Any) -> None:
    with pytest.raises(AttributeError, match=f"'{package.__name__}' has no attribute 'Planer'"):
        _ = package.Planer


@pytest.mark.parametrize("package", [package.__name__ for package in PACKAGES])
def test_import_loads_no_library(package: str) -> None:
    """Every process of a robot imports the package before it does anything else."""
    program = f"import sys, {package}; print(*sys.modules, sep='\\n')"
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in run.stdout.split()}
    assert package.partition(".")[0] in loaded
    assert not loaded & {"numpy", "cv2", "scipy", "yaml", "rosbags"}


@pytest.mark.parametrize("package", PACKAGES)
def test_star_import_gives_every_name(package: Any) -> None:
    space: dict[str, object] = {}
    exec(f"from {package.__name__} import *", space)
    assert {*package.__all__} <= {*space}


def test_page_of_the_library_names_every_public_name() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(?:mrs\.)?(\w+)`", page))
    for package in PACKAGES:
        assert {*package.__all__} <= named


def test_reference_describes_every_public_name() -> None:
    pytest.importorskip("tomllib", reason="make docs needs Python 3.11")
    docs = runpy.run_path(str(ROOT / "setup" / "docs.py"))
    described = {docs["full_name"](m) for _, _, modules in docs["API"].values() for m in modules}
    for package in PACKAGES:
        for name in package.__all__:
            assert getattr(package, name).__module__ in described, name
    for module in described:
        assert importlib.util.find_spec(module), module
