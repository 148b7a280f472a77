"""`mrs keys`: certificates that make a host a member of a team, and revoke it.

One folder per host comes out, with everything that the team's tunnel (OpenVPN: TLS 1.3 over TCP,
where both ends show a certificate) needs there. `docs/security.md` says what it does and what not.
The certificates are made by the `openssl` command.
"""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer

from mrs_tools.common import make_table
from mrs_tools.security.team_keys import DEFAULT_PORT, PLANNER, TeamKeys
from mrs_tools.security.tunnel import RECHECK_S, ROOTS_FOLDER

app = typer.Typer(
    help="Make hosts members of a team, and revoke them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
)
Keys = Annotated[Path, typer.Option("--keys", "-k", help="Folder with the keys of the team.")]
_HERE = Path("keys")


@app.command("init")
def init_command(
    address: Annotated[str, typer.Argument(help="Where robots reach the planner's host.")],
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="TCP port of the tunnel there.")
    ] = DEFAULT_PORT,
    keys: Keys = _HERE,
) -> None:
    """Begin a team: the authority that signs, and the planner's folder."""
    TeamKeys.create(keys, address, port)
    typer.echo(f"made {keys / 'authority'}: it signs. Keep it safe, and off the robots.")
    _say({address: keys / PLANNER})


@app.command("make")
def make_command(
    names: Annotated[
        list[str], typer.Argument(help="Names of robots or laptops, such as robot_a.")
    ],
    keys: Keys = _HERE,
) -> None:
    """Make hosts members: a key, a certificate and a tunnel for each."""
    team = TeamKeys(keys)
    _say({name: team.make(name) for name in names})


def _say(made: dict[str, Path]) -> None:
    """What was made, by host, and what to do with it."""
    for folder in made.values():
        typer.echo(f"made {folder}")
    typer.echo("Copy each to its host and nowhere else, such as with")
    for host, folder in made.items():
        typer.echo(f"    scp -r {folder} {host}:")
    example = next(iter(made.values())).name
    typer.echo(
        "and there make it root's, which runs it (openvpn and iproute2 have to be installed):\n"
        f"    sudo mv {example} {ROOTS_FOLDER}\n"
        f"    sudo chown -R root:root {ROOTS_FOLDER}\n"
        f"    sudo chmod -R go-w {ROOTS_FOLDER} && sudo chmod 755 {ROOTS_FOLDER}\n"
        f"    sudo {ROOTS_FOLDER}/team up             # opens the tunnel; leave it running\n"
        f"    {ROOTS_FOLDER}/team run COMMAND ...     # runs a node, or a shell, inside it"
    )


@app.command("revoke")
def revoke_command(
    name: Annotated[str, typer.Argument(help="Name of the host that leaves the team.")],
    keys: Keys = _HERE,
) -> None:
    """Shut a host out: it is cut off a minute after the planner has the new list."""
    team = TeamKeys(keys)
    path = team.revoke(name)
    typer.echo(
        f"revoked {name}. Copy {path} into the planner's folder on its host, such as with\n"
        f"    scp {path} {team.address}:\n"
        f"    ssh -t {team.address} sudo install -m 644 {path.name} {ROOTS_FOLDER}/\n"
        f"  {name} is out within {RECHECK_S} s; nothing has to be restarted."
    )
    if name == PLANNER:
        typer.echo(
            "  Robots do not read that list. If the planner's key was stolen, begin a new team: "
            "mrs keys init --keys OTHER"
        )


@app.command("list")
def list_command(keys: Keys = _HERE) -> None:
    """List the certificates of a team and when they end."""
    from rich.console import Console

    table = make_table("", "host", "state", "ends")
    now = datetime.now(timezone.utc)
    for one in TeamKeys(keys).certificates():
        days = f" ({(one.ends - now).days} days)" if one.state == "valid" else ""
        table.add_row(one.name, one.state, f"{one.ends:%Y-%m-%d}{days}")
    Console().print(table)
