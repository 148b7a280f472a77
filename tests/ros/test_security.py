"""DDS Security: nodes that require it start only with it; the policy matches the nodes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist
from rclpy.node import NodeNameNonExistentError
from rosgraph_msgs.msg import Clock

from mrs_people_loc.errors import ConfigError
from mrs_ros import security
from ros.forked_starts import Start, ends_of
from ros.harness import DEADLINE_S, ROOT, Peer, Team
from ros.interfaces import interfaces
from ros.tf2 import tf2

ROBOTS = ("robot_a", "robot_b", "robot_c")
POLICY = ROOT / "config" / "sros2" / "policy.xml"
XINCLUDE = "{http://www.w3.org/2001/XInclude}include"
#: In this Fast DDS there is none of DDS Security.
NO_PLUGIN = r"cannot be had: the Fast DDS of this installation is built without its security plugin"
NO_KEYS = (
    r"cannot be had: no keys for this node \(ROS_SECURITY_KEYSTORE is '[^']*', and its enclave"
)


# --- refusing -------------------------------------------------------------------------------------


def has_plugin() -> bool:
    """Whether Fast DDS here has DDS Security, as Ubuntu's has."""
    libraries = [folder / "lib" for folder in (Path(sys.prefix), Path("/opt/ros/jazzy"))]
    fast_dds = next((f for lib in libraries for f in lib.glob("libfastrtps.so")), None)
    return fast_dds is not None and b"DDS:Auth:PKI-DH" in fast_dds.read_bytes()


#: Variables without `ROS_SECURITY_`, the folder of keys and what is reported.
REFUSED: list[tuple[dict[str, str], str | None, str]] = [
    ({"ENABLE": "true", "STRATEGY": "Enforce"}, None, NO_KEYS),
    ({"ENABLE": "true", "STRATEGY": "Enforce"}, "absent", NO_KEYS),
    ({"ENABLE": "true", "STRATEGY": "Enforce"}, "made", NO_PLUGIN),
    ({"ENABLE": "true", "STRATEGY": "Permissive"}, "made", NO_PLUGIN),
    ({"ENABLE": "true"}, "made", NO_PLUGIN),
    ({"ENABLE": "True"}, None, "ROS_SECURITY_ENABLE is 'True'; allowed: true or false"),
    (
        {"ENABLE": "true", "STRATEGY": "ENFORCE"},
        None,
        "ROS_SECURITY_STRATEGY is 'ENFORCE'; allowed: Enforce or Permissive",
    ),
    ({"STRATEGY": "Enforce"}, None, "ROS_SECURITY_ENABLE is not set, so nothing would be"),
]
EXECUTABLES = ("robot_node", "planner_node", "guide_node")
NAMESPACE = ("--ros-args", "-r", "__ns:=/robot_a")


@pytest.fixture(scope="module")
def ends(
    domain: int, tmp_path_factory: pytest.TempPathFactory
) -> dict[tuple[str, int], tuple[int, str]]:
    """Exit code and output of each executable in each case of `REFUSED` that is one here."""
    folder = tmp_path_factory.mktemp("keys")
    (folder / "made" / "enclaves").mkdir(parents=True)
    starts, left_out = {}, NO_PLUGIN if has_plugin() else None
    for executable, (case, refused) in product(EXECUTABLES, enumerate(REFUSED)):
        variables, keystore, reported = refused
        if reported == left_out:  # it might start
            continue
        env = {f"ROS_SECURITY_{name}": value for name, value in variables.items()}
        if keystore:
            env["ROS_SECURITY_KEYSTORE"] = str(folder / keystore)
        starts[executable, case] = Start(executable, NAMESPACE, env)
    return dict(zip(starts, ends_of(list(starts.values()), folder), strict=True))


@pytest.mark.parametrize("executable", EXECUTABLES)
@pytest.mark.parametrize("case", range(len(REFUSED)))
def test_node_does_not_start_without_required_security(
    ends: dict[tuple[str, int], tuple[int, str]], executable: str, case: int
) -> None:
    if (executable, case) not in ends:
        pytest.skip("Fast DDS has its security plugin here")
    code, output = ends[executable, case]
    assert code == 2, output
    assert re.search(REFUSED[case][-1], output), output
    assert "Traceback" not in output


def test_node_that_nobody_forked_ends_the_same(
    ends: dict[tuple[str, int], tuple[int, str]], domain: int
) -> None:
    env = {**os.environ, **{f"ROS_SECURITY_{k}": value for k, value in REFUSED[0][0].items()}}
    ended = subprocess.run(
        [sys.executable, "-m", "robot_node", *NAMESPACE],
        env=env, capture_output=True, text=True, timeout=DEADLINE_S, check=False,
    )  # fmt: skip
    code, output = ends["robot_node", 0]
    assert ended.returncode == code
    assert refusal_in(ended.stderr) == refusal_in(output) != ""


def refusal_in(output: str) -> str:
    """The line that says why a node does not start, without its time."""
    return next(
        (re.sub(r"\d", "", line) for line in output.splitlines() if " cannot be " in line), ""
    )


def test_node_logs_that_it_may_be_unprotected(
    team: Team, peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With `Permissive` a node without keys starts unprotected."""
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    process = team.start("robot_node", namespace="/unsure")
    peer.until(lambda: security.UNSURE in process.log, lambda: process.log)
    peer.until_active("/unsure/robot_node")
    process.stop()


@pytest.mark.parametrize(
    ("enable", "strategy", "wanted"),
    [
        (None, None, ""),
        ("", "", ""),
        ("false", "Enforce", ""),
        ("false", None, ""),
        ("true", None, "Permissive"),
        ("true", "Permissive", "Permissive"),
        ("true", "Enforce", "Enforce"),
    ],
)
def test_security_requested_by_the_environment(
    enable: str | None, strategy: str | None, wanted: str
) -> None:
    pairs = {security.ENABLE: enable, security.STRATEGY: strategy}
    assert security.asked({k: v for k, v in pairs.items() if v is not None}) == wanted


@pytest.mark.parametrize("enable", ["TRUE", "1", "yes", " true", "False"])
def test_values_that_rcl_would_take_for_no_are_refused(enable: str) -> None:
    with pytest.raises(ConfigError, match="allowed: true or false"):
        security.asked({security.ENABLE: enable})


# --- the policy -----------------------------------------------------------------------------------


def allowed(enclave: str, node: str) -> dict[str, set[str]]:
    """Full names that a node may publish, subscribe, reply to and request, as sros2 reads it."""
    (profile,) = ET.parse(POLICY).findall(
        f"enclaves/enclave[@path='{enclave}']/profiles/profile[@node='{node}']"
    )
    sections = []
    for child in profile:
        if child.tag == XINCLUDE:
            assert child.get("xpointer") == "xpointer(/profile/*)"
            sections += list(ET.parse(POLICY.parent / child.attrib["href"]).getroot())
        else:
            sections.append(child)
    namespace = profile.attrib["ns"].rstrip("/")
    found: dict[str, set[str]] = {kind: set() for kind in KINDS}
    for section in sections:
        assert len(section.attrib) == 1
        (kind, rule), *_ = section.attrib.items()
        assert rule == "ALLOW"
        for entry in section:
            name = (entry.text or "").replace("~", f"{namespace}/{node}", 1)
            name = name if name.startswith("/") else f"{namespace}/{name}"
            for one, parts in OF_ACTIONS.get(kind, {kind: ("",)}).items():
                found[one] |= {name + part for part in parts}
    return found


_TOLD = ("/_action/feedback", "/_action/status")
_ASKED = ("/_action/cancel_goal", "/_action/get_result", "/_action/send_goal")
#: What sros2 makes of an action.
OF_ACTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "execute": {"publish": _TOLD, "reply": _ASKED},
    "call": {"subscribe": _TOLD, "request": _ASKED},
}


#: Of the policy: how the graph is asked for it.
KINDS = {
    "publish": "get_publisher_names_and_types_by_node",
    "subscribe": "get_subscriber_names_and_types_by_node",
    "reply": "get_service_names_and_types_by_node",
    "request": "get_client_names_and_types_by_node",
}
#: What `mrs doctor` asks at its end, and `mrs tour stop`, for a moment only: the graph may not show
#: it.
BRIEFLY = {"/stop", "/release"} | {
    f"/{node}/{service}"
    for node in ("planner_node", "guide_node", "*/robot_node")
    for service in ("get_parameters", "get_state")
}
NOTHING: dict[str, set[str]] = {kind: set() for kind in KINDS}


def used(peer: Peer, name: str, namespace: str) -> dict[str, set[str]]:
    """What a node really publishes, subscribes, serves and asks; nothing while it is unknown."""
    try:
        return {
            kind: {topic for topic, _ in getattr(peer.node, method)(name, namespace)}
            for kind, method in KINDS.items()
        }
    except NodeNameNonExistentError:  # its services are known before its name is
        return NOTHING


def difference(policy: dict[str, set[str]], real: dict[str, set[str]]) -> dict[str, set[str]]:
    """What is used and not allowed (`!`), and what is allowed and not used (`?`)."""
    found = {}
    for kind in KINDS:
        matches = {(p, r) for p in policy[kind] for r in real[kind] if fnmatchcase(r, p)}
        found[f"! {kind}"] = real[kind] - {r for _, r in matches}
        found[f"? {kind}"] = policy[kind] - {p for p, _ in matches}
    return {kind: names for kind, names in found.items() if names}


@pytest.fixture(scope="module")
def running(peer: Peer, team: Team, tmp_path_factory: pytest.TempPathFactory) -> Peer:
    """Nodes that, together, do all that configuration can make them do."""
    walls = {"walls.laser": "true", "walls.occupancy_grid": "true", "walls.sonars": "[sonar/left]"}
    top = {"images.top": "true", "localization.run": "always", **walls}
    raw = {**top, "images.rectified": "false", "pose.source": "pose_in", "use_sim_time": "true"}
    with tf2(tmp_path_factory):
        team.start("robot_node", namespace="/robot_a", params=top)
        team.start("robot_node", namespace="/robot_b", params=raw)
        team.start("robot_node", namespace="/robot_c", params={"pose.source": "tf"})
        outputs = {"outputs.person_frames": "true", "outputs.people_costmap": "true"}
        planner = {"robots": "['robot_a']", "use_sim_time": "true", **outputs}
        with interfaces(tmp_path_factory, "people_msgs", "hri_msgs", "vision_msgs"):
            team.start("planner_node", params=planner)
    guide = {"robots": "['robot_a']", "use_sim_time": "true"}
    team.start("guide_node", params=guide)
    team.start("guide_node", namespace="/other", params=guide | {"drive": "nav2"})
    nodes = (*(f"{robot}/robot_node" for robot in ROBOTS), "planner_node", "guide_node")
    peer.until_active(*(f"/{node}" for node in nodes), "/other/guide_node")
    return peer


def as_robot_a(names: dict[str, set[str]], robot: str) -> dict[str, set[str]]:
    """The same of another robot, said of robot_a."""
    return {k: {n.replace(f"/{robot}/", "/robot_a/", 1) for n in v} for k, v in names.items()}


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_policy_of_a_robot_matches_its_topics_and_services(running: Peer) -> None:
    running.send("/robot_a/cmd_vel_guide", Twist())  # from then on it publishes cmd_vel

    def off() -> dict[str, set[str]]:
        each = [as_robot_a(used(running, "robot_node", f"/{r}"), r) for r in ROBOTS]
        real = {kind: set().union(*(one[kind] for one in each)) for kind in KINDS}
        return difference(allowed("/robot_a", "robot_node"), real)

    running.until(lambda: not off(), lambda: off())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_policy_of_the_planner_matches_its_topics_and_services(running: Peer) -> None:
    def off() -> dict[str, set[str]]:
        return difference(allowed("/planner", "planner_node"), used(running, "planner_node", "/"))

    running.until(lambda: not off(), lambda: off())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_policy_of_the_guide_matches_its_topics_and_services(running: Peer) -> None:
    def off() -> dict[str, set[str]]:
        by_velocities, by_goals = (used(running, "guide_node", ns) for ns in ("/", "/other"))
        real = {
            kind: by_velocities[kind] | {name.removeprefix("/other") for name in by_goals[kind]}
            for kind in KINDS
        }
        real["publish"].add("/robot_a/cmd_vel_guide")  # on tours of robots with monitors
        real["subscribe"].add("/robot_a/cmd_vel")
        return difference(allowed("/guide", "guide_node"), real)

    running.until(lambda: not off(), lambda: off())


def test_all_robots_have_the_same_policy() -> None:
    for robot in ROBOTS:
        same = as_robot_a(allowed(f"/{robot}", "robot_node"), robot)
        assert same == allowed("/robot_a", "robot_node")


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("node", "command"),
    [
        ("mrs_people", ("people",)),
        ("mrs_record", ("record", "OUT", "/tracked_people")),
        ("mrs_doctor", ("doctor", "--duration", "600")),
        # Where nobody guides, so that it waits.
        ("mrs_tour", ("tour", "TOUR", "--namespace", "/nobody", "--attended")),
    ],
)
def test_policy_of_the_tools_matches_their_topics_and_services(
    running: Peer, domain: int, tmp_path: Path, node: str, command: tuple[str, ...]
) -> None:
    (tmp_path / "tour.yaml").write_text("points: [[0, 0], [4, 0]]")
    files = {"OUT": tmp_path / "out.mcap", "TOUR": tmp_path / "tour.yaml"}
    arguments = [str(files.get(argument, argument)) for argument in command]
    namespace, enclave = ("/nobody", "/tours") if node == "mrs_tour" else ("/", "/tools")
    if node == "mrs_people":  # takes its time from there, if it is published
        running.publisher(Clock, "/clock")
    with subprocess.Popen(
        [sys.executable, "-m", "mrs_tools", *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip

        def off() -> dict[str, set[str]]:
            names = [n for n in running.node.get_node_names() if n.startswith(node)]
            found = used(running, names[0], namespace) if names else NOTHING
            real = {kind: {n.removeprefix("/nobody") for n in found[kind]} for kind in KINDS}
            policy = allowed(enclave, node)
            return difference(policy | {"request": policy["request"] - BRIEFLY}, real)

        try:
            running.until(lambda: not off(), lambda: off())
        finally:
            process.terminate()


def test_difference_from_the_policy_is_found() -> None:
    policy = NOTHING | {"publish": {"/a", "/b/*"}}
    real = NOTHING | {"publish": {"/a", "/c"}}
    assert difference(policy, real) == {"! publish": {"/c"}, "? publish": {"/b/*"}}
