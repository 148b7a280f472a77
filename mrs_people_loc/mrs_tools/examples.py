"""Examples of each command, as its `--help` ends with."""

from __future__ import annotations

#: By command, without `mrs`: what to write behind it, and what that does.
EXAMPLES: dict[str, dict[str, str]] = {
    "calibrate": {
        "--robot robot_a -c team.yaml": "a running robot that stands on free floor",
        "walk.mcap -c team.yaml": "every robot of a bag",
    },
    "up": {
        "config/team.yaml": "the robots of that file, and the planner",
        "config/team.yaml --guide": "the guide, too",
    },
    "tour": {
        "museum.yaml": "guide a group by the running guide_node",
        "museum.yaml --attended": "... which stops within 2 s where this command does",
        "stop": "the robots stand",
        "release": "... no longer; a tour goes on",
        "--simulate --scene guided_hall": "on this machine, without robots",
    },
    "discovery-server": {"--port 11811": "the others get this host's address"},
    "people": {
        "": "until Ctrl-C",
        "--duration 10": "ten seconds",
    },
    "view": {
        "": "in the browser of this machine",
        "walk.mcap": "a recording, with a time line",
        "--host 0.0.0.0 --control --tour museum.yaml": "from a tablet, which may start the tour",
    },
    "doctor": {"": "four seconds", "--duration 10": "where messages come rarely"},
    "replay": {
        "walk.mcap --clock": "with bag time on /clock, for nodes at use_sim_time",
        "walk.mcap -t '/robot_a/*' --rate 0.5 --loop": "one robot, slowly, again and again",
    },
    "record": {
        "walk.mcap": "what the nodes take in and say, until Ctrl-C",
        "walk.mcap '/robot_a/*' --duration 60": "a minute of one robot's topics",
        "--recover walk.mcap": "what a recorder that was killed left",
    },
    "keys init": {"planner.local": "robots will reach the planner's host there"},
    "keys make": {"robot_a robot_b laptop": "a key, a certificate and a tunnel for each"},
    "keys revoke": {"robot_b": "the computer of robot_b was stolen"},
    "keys list": {"": "of the folder keys"},
}


def epilog(command: str) -> str:
    """The examples of a command, or of all commands of a group, as Markdown.

    Args:
        command: Its name without `mrs`, such as `doctor` or `keys init`.
    """
    lines = [
        f"- `{' '.join(filter(None, ('mrs', name, arguments)))}`: {what}"
        for name, examples in EXAMPLES.items()
        if name == command or name.startswith(f"{command} ")
        for arguments, what in examples.items()
    ]
    return "\n\n".join(["Examples:", *lines]) if lines else ""
