"""The packages are found and start, from wherever and however they were installed."""

import ast
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import mrs_people_loc

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "mrs_people_loc" / "mrs_people_loc"
PACKAGES = {  # ROS package -> its folder
    "mrs_people_bags": "bags",
    "mrs_people_config": "config",
    "mrs_people_loc": "mrs_people_loc",
    "mrs_people_msgs": "msgs",
    "mrs_people_sim": "simulation",
    "planner_node": "planner_node",
    "robot_node": "robot_node",
}
#: Data packages: what of them is installed.
DATA = {
    "config": ("*.yaml", "*.rviz", "*.json", "*/*.xml", "*/*.yaml", "scenes/*"),
    "bags": ("*.yaml", "*_*/*"),
}
EXECUTABLES = [
    ("mrs_people_loc", "mrs"),
    ("planner_node", "planner_node"),
    ("planner_node", "guide_node"),
    ("robot_node", "robot_node"),
]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
#: Groups of the lock, and their extras (setup/lock.py); the other extras are always installed.
GROUPS = {
    "sim": {"plots", "sim", "convert"},
    "test": {"test"},
    "lint": {"lint"},
    "fuzz": {"fuzz"},
}


def package_prefix(package: str, prefixes: str) -> Path:
    """Find a package as the ament index does: by its marker under one of the prefixes."""
    for prefix in map(Path, prefixes.split(os.pathsep)):
        if (prefix / "share/ament_index/resource_index/packages" / package).is_file():
            return prefix
    pytest.fail(f"{package} is not in the ament index of {prefixes}")


def executable_path(package: str, executable: str, prefixes: str) -> Path:
    """Find an executable as `ros2 run` does: executable files of that name in lib/PACKAGE."""
    folder = package_prefix(package, prefixes) / "lib" / package
    paths = [p for p in folder.rglob(executable) if p.is_file() and os.access(p, os.X_OK)]
    assert len(paths) == 1, f"{folder} holds {paths}"
    return paths[0]


def shared_files() -> Iterator[tuple[str, str, Path]]:
    """Yield what ROS looks up: package, path under its share/ folder, source file."""
    for package, folder in PACKAGES.items():
        yield package, "package.xml", ROOT / folder / "package.xml"
        for path in sorted((ROOT / folder / "launch").glob("*.launch.py")):
            yield package, f"launch/{path.name}", path
    for folder, patterns in DATA.items():
        for path in sorted(path for each in patterns for path in (ROOT / folder).glob(each)):
            package = f"mrs_people_{folder}"
            yield package, str(path.relative_to(ROOT / folder)), path


def python_files() -> Iterator[tuple[str, Path]]:
    """Yield every file of the Python packages: ROS package, path under its folder."""
    for package, folder in PACKAGES.items():
        for init in (ROOT / folder).glob("*/__init__.py"):
            for path in init.parent.rglob("*"):
                if path.is_file() and "__pycache__" not in path.parts:
                    yield package, path.relative_to(ROOT / folder)


def extras_of(lock: str) -> set[str]:
    """Name the extras that a file of requirements/ pins."""
    extras = set(metadata.metadata("mrs-people-loc").get_all("Provides-Extra") or [])
    return {"docs"} if lock == "docs.txt" else extras - {"docs"}


def check_shared_files(prefixes: str, but: tuple[str, ...] = ()) -> None:
    """Hold every file that ROS looks up against its source."""
    for package, name, source in shared_files():
        if package not in but:
            installed = package_prefix(package, prefixes) / "share" / package / name
            assert installed.read_bytes() == source.read_bytes(), f"{installed} is out of date"


@pytest.fixture(scope="module")
def prefixes() -> str:
    """Where this environment's packages lie (tests/conftest.py sets it if nothing else did)."""
    return os.environ["AMENT_PREFIX_PATH"]


# --- the environment that the tests run in -------------------------------------------------------


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_found(package: str, prefixes: str) -> None:
    ament_index = pytest.importorskip("ament_index_python.packages")
    assert Path(ament_index.get_package_prefix(package)) == package_prefix(package, prefixes)


def test_shared_files_are_installed(prefixes: str) -> None:
    check_shared_files(prefixes)


@pytest.mark.parametrize(("package", "executable"), EXECUTABLES)
def test_executable_starts_from_an_empty_environment(
    package: str, executable: str, prefixes: str, tmp_path: Path
) -> None:
    path = executable_path(package, executable, prefixes)
    run = subprocess.run(
        [path, "--help"], env={}, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout
    assert not run.stderr


@pytest.mark.parametrize(("package", "executable"), EXECUTABLES)
def test_script_runs_the_python_of_its_own_prefix(
    package: str, executable: str, tmp_path: Path
) -> None:
    """The script of the pip install: right interpreter, arguments kept, ament index set."""
    script = tmp_path / "a prefix" / "lib" / package / executable
    python = tmp_path / "a prefix" / "bin" / "python3"
    for path, text in [
        (script, (ROOT / package / "scripts" / executable).read_text()),
        (python, '#!/bin/sh\nprintf "%s\\n" "$AMENT_PREFIX_PATH" "$@"\n'),
    ]:
        path.parent.mkdir(parents=True)
        path.write_text(text)
        path.chmod(0o755)
    modules = {"mrs": "mrs_tools", "guide_node": "planner_node.guide_node"}
    module = modules.get(executable, executable)

    def reported(environment: dict[str, str]) -> list[str]:
        command = [str(script), "--team", "a b"]
        run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return run.stdout.splitlines()

    prefix = str(tmp_path / "a prefix")
    assert reported({}) == [prefix, "-m", module, "--team", "a b"]
    assert reported({"AMENT_PREFIX_PATH": "/ros"})[0] == f"{prefix}:/ros"


def test_manifests_agree() -> None:
    """Version, maintainer, licence and addresses are those of the distribution."""
    project = metadata.metadata("mrs-people-loc")
    version = project["Version"]
    assert mrs_people_loc.__version__ == version
    for package, folder in PACKAGES.items():
        manifest = ET.parse(ROOT / folder / "package.xml").getroot()
        assert manifest.findtext("name") == package
        assert manifest.findtext("version") == version, folder
        (maintainer,) = manifest.findall("maintainer")
        written = f"{maintainer.text} <{maintainer.get('email')}>"
        assert written == project["Maintainer-email"], folder
        addresses = {each.partition(", ")[2] for each in project.get_all("Project-URL") or []}
        assert {each.text for each in manifest.findall("url")} <= addresses, folder
        (licence,) = manifest.findall("license")
        assert licence.text == project["License-Expression"], folder
        text = ROOT / folder / str(licence.get("file"))
        assert not text.is_symlink()  # bloom would find nothing behind it
        assert text.read_bytes() == (ROOT / "LICENSE").read_bytes()
        for build in (ROOT / folder / "setup.py", ROOT / folder / "pyproject.toml"):
            if build.exists():
                found = re.findall(r'^ *version ?= ?"(.*)"', build.read_text(), re.MULTILINE)
                assert found == [version], build


@pytest.mark.parametrize("package", sorted({*PACKAGES} - {"mrs_people_msgs"}))
def test_package_folder_is_complete_alone(package: str, tmp_path: Path) -> None:
    """As bloom exports it: without what is beside it in the repository."""
    alone, installed = tmp_path / "alone", tmp_path / "installed"
    made = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    shutil.copytree(ROOT / PACKAGES[package], alone, symlinks=True, ignore=made)
    if (alone / "setup.py").exists():
        steps = ["install_data", f"--install-dir={installed}"]
        steps += ["build_py", f"--build-lib={installed}"]
        subprocess.run([sys.executable, "setup.py", "--quiet", *steps], cwd=alone, check=True)
    else:  # data
        build = ["hatchling", "build", "--target=wheel", f"--directory={tmp_path}"]
        subprocess.run([sys.executable, "-m", *build], cwd=alone, check=True)
        (wheel,) = tmp_path.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path)
        (data,) = tmp_path.glob("*.data/data")
        data.rename(installed)
    for owner, name, source in shared_files():
        if owner == package:
            file = installed / "share" / package / name
            assert file.read_bytes() == source.read_bytes(), name
    for owner, path in python_files():
        assert owner != package or (installed / path).is_file(), path


def test_extra_all_holds_every_extra() -> None:
    """It is what the lock pins and `make setup` installs."""
    requirements = [Requirement(line) for line in metadata.requires("mrs-people-loc") or []]

    def names(extra: str) -> set[str]:
        wanted = (r for r in requirements if r.marker and r.marker.evaluate({"extra": extra}))
        return {r.name for r in wanted}

    for extra in extras_of("lock.txt"):
        assert names(extra) <= names("all"), extra


@pytest.mark.parametrize(
    ("lock", "python"),
    [
        *(("lock.txt", python) for python in PYTHONS),
        *(("docs.txt", python) for python in PYTHONS[1:]),
    ],
)
def test_lock_satisfies_every_requirement(lock: str, python: str) -> None:
    """Someone who adds a dependency runs `make lock`."""
    environment = {"python_version": python, "python_full_version": f"{python}.0", "extra": "all"}
    pins = {}
    for line in (ROOT / "requirements" / lock).read_text().splitlines():
        text, _, groups = line.partition("  #")
        if line and not line.startswith("#"):
            pin = Requirement(text)
            if pin.marker is None or pin.marker.evaluate(environment):
                assert pin.name not in pins, f"{pin.name} is pinned twice for {python}"
                pins[pin.name] = pin.specifier, groups.split()
    for requirement in map(Requirement, metadata.requires("mrs-people-loc") or []):
        name = canonicalize_name(requirement.name)
        marker = requirement.marker
        if marker is None:  # of the project itself, which the site does not import
            extras = {""} if lock == "lock.txt" else set()
        else:
            marked = {e for e in extras_of(lock) if marker.evaluate({**environment, "extra": e})}
            extras = marked - {"all"}
        if name != "mrs-people-loc" and extras:
            (pinned,), marks = pins[name]
            assert requirement.specifier.contains(pinned.version, prereleases=True), requirement
            for extra in extras:  # of a group: marked with it, or installed for every target
                of = [group for group, held in GROUPS.items() if extra in held]
                assert set(of) <= set(marks) if of and marks else not marks, requirement


def test_wheels_are_installed_by_group(tmp_path: Path) -> None:
    """Pins without a group always; pip takes what uv cannot."""
    files = {
        "requirements/lock.txt": "# pins\na==1\nb==2 ; c == 'd'  # sim\nc==3  # lint test\n",
        "venv/bin/uv": "#!/bin/sh\nexit 1\n",
        "venv/bin/python": '#!/bin/sh\necho "$@"\n',
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def installed(*groups: str) -> list[str]:
        command = [f"{ROOT}/setup/install.sh", "venv", *groups]
        run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert " install --no-deps --no-build-isolation --requirement venv/lock.txt\n" in run.stdout
        return re.findall(r"^\w", (tmp_path / "venv/lock.txt").read_text(), re.MULTILINE)

    assert installed() == ["a"]
    assert installed("sim") == ["a", "b"]
    assert installed("lint", "sim") == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("python", "packages"),
    [
        ("#!/bin/sh\necho 3.9\n", "g++ make"),  # too old, no apt-cache to ask
        ("#!/bin/sh\nexit 1\n", "python3 python3-venv python3-dev g++ make"),
        # Debian's Python alone: it answers, but the modules and the header are not there.
        ('#!/bin/sh\ncase $2 in *print*) echo 3.11;; *) exit 1;; esac\n',
         "python3.11-venv python3.11-dev g++ make"),
    ],
    ids=["old", "none", "bare"],
)  # fmt: skip
def test_setup_names_all_that_is_missing_at_once(
    python: str, packages: str, tmp_path: Path
) -> None:
    for tool in ("dirname", "sh", "uname"):
        (tmp_path / tool).symlink_to(str(shutil.which(tool)))
    (tmp_path / "python3").write_text(python)
    (tmp_path / "python3").chmod(0o755)
    run = subprocess.run(
        ["/bin/sh", f"{ROOT}/setup/check.sh", "python3", "3.12 3.11"],
        env={"PATH": str(tmp_path), "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 1
    assert not run.stderr
    for lacking in ("Python", "C++ compiler", "make"):
        assert lacking in run.stdout
    assert run.stdout.endswith(f"sudo apt-get install {packages}\n")


#: Keys of rosdep that give packages of Ubuntu 24.04 (rosdep/python.yaml of ros/rosdistro at
#: 8468e88), and ROS packages of Jazzy (jazzy/distribution.yaml there). Look a new one up before it
#: goes here.
SYSTEM_KEYS = {
    "python3-aiohttp",  # at 000730d
    "python3-matplotlib",
    "python3-numpy",
    "python3-opencv",
    "python3-pytest",
    "python3-rich",
    "python3-scipy",
    "python3-typer",
    "python3-yaml",
}
JAZZY_KEYS = {
    "action_msgs",
    "ament_cmake",
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "ros2launch",
    "rosgraph_msgs",
    "rosidl_default_generators",
    "rosidl_default_runtime",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "stereo_msgs",
    "visualization_msgs",
}


def test_rosdep_knows_every_dependency_and_asks_pip_for_none() -> None:
    """Ubuntu's Python takes nothing from pip: one such key would stop `rosdep install`."""
    for package, folder in PACKAGES.items():
        manifest = ET.parse(ROOT / folder / "package.xml").getroot()
        keys = {str(each.text) for each in manifest if each.tag.endswith("depend")}
        assert keys
        assert keys <= SYSTEM_KEYS | JAZZY_KEYS | set(PACKAGES), package


def test_camera_recipes_give_every_input_its_name() -> None:
    """Each launch file of docs/cameras.md: what robot_node hears, each from a topic of its own."""
    text = (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")
    recipes = re.findall(r"```xml\n(.*?)```", text, re.DOTALL)
    assert len(recipes) == 3
    for recipe in recipes:
        launch = ET.fromstring(recipe)
        remaps = {each.get("from"): each.get("to") for each in launch.iter("set_remap")}
        sides, topics = ("left", "right"), ("image_rect", "camera_info")
        wanted = {f"/robot_a/{side}/{topic}" for side in sides for topic in topics}
        assert len(remaps) == len(wanted)
        assert set(remaps.values()) == wanted
        # Renamed is the driver alone: the group ends before our node.
        (driver,) = launch.findall("group/include")
        (ours,) = launch.findall("include")
        assert "robot.launch.py" in str(ours.get("file"))
        arguments = {each.get("name"): each.get("value") for each in driver.findall("arg")}
        assert {"robot_a", "head"} <= set(arguments.values())


# --- layers --------------------------------------------------------------------------------------


def imported(path: Path) -> set[str]:
    """Return the top-level names of all that a module imports, inside functions too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(str(node.module).partition(".")[0])
    return names


def test_core_imports_only_what_it_declares() -> None:
    allowed = {"numpy", "cv2", "scipy", "yaml", "mrs_people_loc"} | sys.stdlib_module_names
    for path in CORE.rglob("*.py"):
        assert imported(path) <= allowed, path


def test_core_loads_no_ros() -> None:
    """Import every module of the core where ROS cannot be imported."""
    program = """
import importlib, pkgutil, re, sys

ROS = re.compile(r"rclpy|rosbags|launch|mrs_ros|(ament|rosidl|tf2)_|\\w+_(msgs|interfaces)\\b")

class NoROS:
    def find_spec(self, name, path=None, target=None):
        if ROS.match(name):
            raise AssertionError(f"the core imports {name}")

sys.meta_path.insert(0, NoROS())
import mrs_people_loc
for module in pkgutil.walk_packages(mrs_people_loc.__path__, "mrs_people_loc."):
    print(importlib.import_module(module.name).__name__)
"""
    command = [sys.executable, "-W", "error", "-c", program]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    files = (path.relative_to(CORE.parent).with_suffix("") for path in CORE.rglob("*.py"))
    modules = {".".join(file.parts).removesuffix(".__init__") for file in files}
    assert modules - {"mrs_people_loc"} == set(run.stdout.split())


# --- colcon --------------------------------------------------------------------------------------


def colcon_build(folder: Path, *options: str) -> dict[str, str]:
    """Build into the folder; return the environment that its setup.sh makes of an empty one."""
    build = [f"{ROOT}/setup/colcon.sh", sys.prefix, str(folder), *options]
    run = subprocess.run(
        build, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    assert run.returncode == 0, run.stdout
    source = f'COLCON_CURRENT_PREFIX="{folder}/install" . "{folder}/install/local_setup.sh"; env -0'
    shell = ["env", "-i", "PATH=/usr/bin:/bin", "sh", "-c", source]
    listing = subprocess.run(shell, capture_output=True, text=True, check=True).stdout
    return dict(line.split("=", 1) for line in listing.split("\0") if line)


@pytest.mark.slow
@pytest.mark.timeout(600)  # 40 s where nothing else runs
@pytest.mark.parametrize(
    "options",
    # The messages take most of the time; they are linked no other way than they are copied.
    [(), ("--symlink-install", "--packages-ignore", "mrs_people_msgs")],
    ids=["copied", "linked"],
)
def test_colcon_workspace(options: tuple[str, ...], tmp_path: Path) -> None:
    if not (Path(sys.prefix) / "bin" / "colcon").exists():
        pytest.skip("colcon is not in this environment")
    if " " in sys.prefix:
        pytest.skip("colcon's setup.sh cannot run a Python that has a space in its path")
    environment = colcon_build(tmp_path, *options)
    prefixes = environment["AMENT_PREFIX_PATH"]
    but = ("mrs_people_msgs",) if options else ()

    for package in set(PACKAGES) - set(but):
        assert package_prefix(package, prefixes) == tmp_path / "install" / package
    check_shared_files(prefixes, but)
    if not options:
        for package, name in python_files():
            (site_packages,) = (tmp_path / "install" / package).glob("lib/python*/site-packages")
            assert (site_packages / name).is_file()
    # For who is not in the repository.
    for folder, what in (("bags", "walking_group"), ("config", "scenes/suite.yaml")):
        program = (
            "from mrs_tools.installing import default_file; "
            f"print(default_file({folder!r}, {what!r}))"
        )
        command = [f"{sys.prefix}/bin/python", "-c", program]
        run = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        package = f"mrs_people_{folder}"
        installed = tmp_path / "install" / package / "share" / package / what
        assert options or run.stdout.strip() == str(installed), run.stderr
    for package, executable in EXECUTABLES:
        path = executable_path(package, executable, prefixes)
        run = subprocess.run(
            [path, "--help"],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        assert run.stdout
