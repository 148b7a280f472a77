"""`mrs keys`: certificates that make a host a member of a team, and revoke it.

One folder per host comes out, with everything that the team's tunnel (OpenVPN: TLS 1.3 over TCP,
where both ends show a certificate) needs there. `docs/security.md` says what it does and what not.
The certificates are made by the `openssl` command.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Annotated

import typer

from mrs_people_loc.errors import KeysError

#: The host that the others connect to.
PLANNER = "planner"
DEFAULT_PORT = 5101
#: How long certificates hold [days]. A list of revoked ones that runs out would shut out everybody.
_HOST_DAYS, _TEAM_DAYS = 2 * 365, 20 * 365
#: They begin to hold a day before they are made: clocks of robots differ.
_BEGIN = timedelta(days=1)
_AUTHORITY_NAME = "team"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_ADDRESS = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,252}")
#: Places in openssl's own source, and what it always says.
_OPENSSL_NOISE = re.compile(r"[0-9A-F]+:error:|Using configuration from ")
_TIME = "%Y%m%d%H%M%SZ"

_OPENSSL = """\
[ca]
default_ca = team
[team]
dir = .
certificate = $dir/ca.pem
private_key = $dir/ca.key
database = $dir/index.txt
new_certs_dir = $dir/issued
crlnumber = $dir/crlnumber
rand_serial = yes
unique_subject = yes
default_md = sha256
policy = name_only
copy_extensions = none
[name_only]
commonName = supplied
[req]
distinguished_name = none
[none]
[authority]
basicConstraints = critical, CA:true, pathlen:0
keyUsage = critical, keyCertSign, cRLSign
subjectKeyIdentifier = hash
[robot]
basicConstraints = critical, CA:false
keyUsage = critical, digitalSignature
extendedKeyUsage = critical, clientAuth
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
[planner]
basicConstraints = critical, CA:false
keyUsage = critical, digitalSignature
extendedKeyUsage = critical, serverAuth
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
"""

_TUNNEL = """\
# The tunnel of a team, for OpenVPN 2.6. Started by `sudo team up`, in this folder.
dev mrs0
dev-type tun
topology subnet
ca ca.pem
cert cert.pem
key key.pem
tls-version-min 1.3
cipher AES-256-GCM
disable-dco
verb 1
persist-key
persist-tun
# `team attach` puts the tunnel's interface into a network namespace of its own.
script-security 2
up "./team attach"
ifconfig-noexec
route-noexec
# What waits longer than this is dropped: a late scan is of no use.
tcp-queue-limit 64
socket-flags TCP_NODELAY
"""

_PLANNER_TUNNEL = """\
proto tcp-server
port {port}
server 10.99.0.0 255.255.255.0
# Everybody keeps his address, over restarts, too: DDS would take him for somebody new.
ifconfig-pool-persist addresses 5
# Robots and laptops of the team reach each other, too.
client-to-client
dh none
# Whom it lets in: who shows a certificate of this team, made for a robot and not revoked.
remote-cert-tls client
crl-verify crl.pem
# Everybody shows it again so often [s]: so long can one stay who was revoked.
reneg-sec {recheck_s}
# A robot that hears nothing for 4 s connects anew.
keepalive 1 4
"""

_ROBOT_TUNNEL = """\
client
proto tcp-client
remote {address} {port}
nobind
# Whom it talks to: who shows a certificate of this team that was made for the planner.
remote-cert-tls server
verify-x509-name planner name
reneg-sec 0
connect-timeout 3
connect-retry 1 1
"""

#: Where a host's folder goes: the tunnel is root's, and so is what it runs.
ROOTS_FOLDER = "/etc/mrs_team"
#: How often everybody shows his certificate again [s].
RECHECK_S = 60

_TEAM_SCRIPT = """\
#!/bin/sh
# sudo team up        opens the tunnel of the team on this host; Ctrl-C or SIGTERM closes it.
# team run COMMAND    runs a command as you, where the tunnel is the only network.
netns=mrs
case $1 in
up)
    cd -P "$(dirname "$0")" || exit
    # Root runs what lies here: nobody else may write to it, or put something else in its place.
    others=$(find . ! -user root -o ! -type l -perm /022)
    at=$PWD
    until [ "$at" = / ]; do
        at=$(dirname "$at")
        others="$others $(find "$at" -prune \\( ! -user root -o -perm /022 ! -perm -1000 \\))"
    done
    if [ "$(echo $others)" ]; then
        echo "error: root would run what others may write:" $others >&2
        echo "Make $PWD root's, in a folder of root's, and run it there:" >&2
        echo "    sudo mv $PWD @ROOT@" >&2
        echo "    sudo chown -R root:root @ROOT@" >&2
        echo "    sudo chmod -R go-w @ROOT@ && sudo chmod 755 @ROOT@" >&2
        exit 1
    fi
    [ -e "/run/netns/$netns" ] || ip netns add "$netns" || exit
    ip -n "$netns" link set lo up || exit
    exec openvpn --config tunnel.conf
    ;;
attach) # called by openvpn: attach DEVICE MTU 0 ADDRESS MASK ...
    ip link set dev "$2" netns "$netns" || exit
    ip -n "$netns" address add "$5/24" dev "$2" || exit
    ip -n "$netns" link set dev "$2" mtu "$3" multicast on up || exit
    ip -n "$netns" route replace default dev "$2"
    ;;
run)
    shift
    if ! [ -e "/run/netns/$netns" ]; then
        echo "error: there is no tunnel; open it with: sudo @ROOT@/team up" >&2
        exit 1
    fi
    [ "$(id -u)" -ne 0 ] || exec ip netns exec "$netns" "$@"
    # sudo changes these even with -E, and ROS lives by them.
    exec sudo -E ip netns exec "$netns" \\
        setpriv --reuid "$(id -u)" --regid "$(id -g)" --init-groups \\
        env "HOME=$HOME" "PATH=$PATH" \\
        ${LD_LIBRARY_PATH:+"LD_LIBRARY_PATH=$LD_LIBRARY_PATH"} \\
        ${PYTHONPATH:+"PYTHONPATH=$PYTHONPATH"} \\
        "$@"
    ;;
*)
    sed -n '2,3s/# //p' "$0" >&2
    exit 2
    ;;
esac
""".replace("@ROOT@", ROOTS_FOLDER)


@dataclass(frozen=True)
class Certificate:
    """One certificate that the team has issued.

    Attributes:
        name: Of the host.
        state: `valid`, `revoked` or `expired`.
        ends: When it ends, or ended.
    """

    name: str
    state: str
    ends: datetime


class TeamKeys:
    """The keys of a team: its authority, and a folder for each host.

    Args:
        folder: Holds `authority/` (which signs: keep it off the robots) and a folder per host.

    Raises:
        KeysError: There is no team there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._authority = folder / "authority"
        try:
            told = json.loads((self._authority / "team.json").read_text())
            self.address, self.port = str(told["address"]), int(told["port"])
        except FileNotFoundError:
            raise KeysError(
                f"{folder}: no keys of a team; make them with: mrs keys init ADDRESS"
            ) from None
        except (
            OSError,
            ValueError,
            LookupError,
            TypeError,
            ArithmeticError,
            RecursionError,
        ) as err:
            raise KeysError(f"{self._authority / 'team.json'}: {err}") from err

    @classmethod
    def create(cls, folder: Path, address: str, port: int = DEFAULT_PORT) -> TeamKeys:
        """Begins a team: its authority, and the planner's folder.

        Args:
            folder: Is made.
            address: Host name or IPv4 address by which robots reach the planner's host.
            port: TCP port there.

        Raises:
            KeysError: There are keys already, the address is none, or openssl fails.
        """
        if not _ADDRESS.fullmatch(address):
            raise KeysError(f"address is {address!r}; allowed: a host name or an IPv4 address")
        authority = folder / "authority"
        if authority.exists():
            raise KeysError(
                f"{authority} exists already: robots with its keys would be shut out; "
                "name another folder with --keys"
            )
        made = _new_folder(authority)
        (made / "issued").mkdir()
        (made / "index.txt").touch()
        (made / "crlnumber").write_text("01\n")
        (made / "openssl.cnf").write_text(_OPENSSL)
        (made / "team.json").write_text(json.dumps({"address": address, "port": port}) + "\n")
        _make_key(made / "ca.key")
        _openssl(
            made, "req", "-new", "-config", "openssl.cnf", "-key", "ca.key",
            "-subj", f"/CN={_AUTHORITY_NAME}", "-out", "request.pem",
        )  # fmt: skip
        _openssl(
            made, "ca", "-batch", "-notext", "-selfsign", "-config", "openssl.cnf",
            "-in", "request.pem", "-extensions", "authority", *_period(_TEAM_DAYS),
            "-out", "ca.pem",
        )  # fmt: skip
        (made / "request.pem").unlink()
        made.rename(authority)
        team = cls(folder)
        team.make(PLANNER)
        return team

    def make(self, name: str) -> Path:
        """Makes a host's folder: its key, its certificate and its tunnel.

        Args:
            name: Of the robot (or laptop): small letters, digits and `_`.

        Returns:
            The folder, which goes to that host and nowhere else.

        Raises:
            KeysError: The name is taken or not allowed, or openssl fails.
        """
        if not _NAME.fullmatch(name) or name in ("authority", _AUTHORITY_NAME):
            raise KeysError(
                f"name is {name!r}; allowed: small letters, digits and _, at most 32, the first "
                "one a letter; not authority or team"
            )
        folder = self.folder / name
        valid = any(c.name == name and c.state == "valid" for c in self.certificates())
        if folder.exists():
            why = "" if valid else ": nobody takes its keys any more, so move it away"
            raise KeysError(f"{folder} exists already; it is not overwritten{why}")
        if valid:
            raise KeysError(f"{name} has a valid certificate; first: mrs keys revoke {name}")
        made = _new_folder(folder)
        _make_key(made / "key.pem")
        request = made / "request.pem"
        self._openssl("ca", "-config", "openssl.cnf", "-updatedb")  # what has ended may come again
        self._openssl(
            "req", "-new", "-config", "openssl.cnf", "-key", made / "key.pem",
            "-subj", f"/CN={name}", "-out", request,
        )  # fmt: skip
        self._openssl(
            "ca", "-batch", "-notext", "-config", "openssl.cnf", "-in", request,
            "-extensions", "planner" if name == PLANNER else "robot",
            *_period(_HOST_DAYS),
            "-out", made / "cert.pem",
        )  # fmt: skip
        request.unlink()
        shutil.copy(self._authority / "ca.pem", made)
        rest = _PLANNER_TUNNEL if name == PLANNER else _ROBOT_TUNNEL
        rest = rest.format(address=self.address, port=self.port, recheck_s=RECHECK_S)
        (made / "tunnel.conf").write_text(_TUNNEL + rest)
        (made / "team").write_text(_TEAM_SCRIPT)
        (made / "team").chmod(0o755)
        made.rename(folder)
        if name == PLANNER:
            self._list_revoked()
        return folder

    def revoke(self, name: str) -> Path:
        """Revokes a host's certificate.

        Returns:
            The new list of revoked certificates, to be copied to the planner.

        Raises:
            KeysError: The host has no valid certificate, or openssl fails.
        """
        serial = next((s for c, s in self._index() if c.name == name and c.state == "valid"), None)
        if serial is None:
            names = sorted({c.name for c in self.certificates() if c.state == "valid"})
            raise KeysError(f"no valid certificate for {name!r}; there are: {', '.join(names)}")
        self._openssl("ca", "-config", "openssl.cnf", "-revoke", f"issued/{serial}.pem")
        return self._list_revoked()

    def certificates(self) -> list[Certificate]:
        """All certificates of hosts that were issued, in their order."""
        return [certificate for certificate, _ in self._index()]

    def _index(self) -> list[tuple[Certificate, str]]:
        """Certificates of hosts with their serial numbers, as `openssl ca` keeps them."""
        try:
            lines = (self._authority / "index.txt").read_text().splitlines()
        except (OSError, ValueError) as err:
            raise KeysError(f"{self._authority}: {err}") from err
        now, found = datetime.now(timezone.utc), []
        for line in lines:
            try:
                state, ends, _, serial, _, subject = line.split("\t")
                # Two digits of the year up to 2049 (RFC 5280, 4.1.2.5).
                end = datetime.strptime(f"20{ends}" if len(ends) == 13 else ends, _TIME)
            except ValueError as err:
                raise KeysError(f"{self._authority / 'index.txt'}: {line!r} is no entry") from err
            end = end.replace(tzinfo=timezone.utc)
            kind = "revoked" if state == "R" else "expired" if end < now else "valid"
            name = subject.removeprefix("/CN=")
            if name != _AUTHORITY_NAME:
                found.append((Certificate(name, kind, end), serial))
        return found

    def _list_revoked(self) -> Path:
        """Writes the list of revoked certificates where the planner takes it."""
        folder = self.folder / PLANNER
        folder.mkdir(mode=0o700, exist_ok=True)
        path = folder / "crl.pem"
        part, now = path.with_suffix(".part"), datetime.now(timezone.utc)
        self._openssl(
            "ca", "-config", "openssl.cnf", "-gencrl", "-crl_lastupdate", f"{now - _BEGIN:{_TIME}}",
            "-crl_nextupdate", f"{now + timedelta(days=_TEAM_DAYS):{_TIME}}", "-out", part,
        )  # fmt: skip
        part.replace(path)  # a planner on this host may read it right now
        return path

    def _openssl(self, *arguments: str | Path) -> None:
        _openssl(self._authority, *arguments)


def _period(days: float) -> tuple[str, ...]:
    """From when to when a certificate holds, for `openssl ca`."""
    now = datetime.now(timezone.utc)
    end = now + timedelta(days=days)
    return "-startdate", f"{now - _BEGIN:{_TIME}}", "-enddate", f"{end:{_TIME}}"


def _new_folder(path: Path) -> Path:
    """A new folder that is renamed to `path` once it is whole."""
    part = path.with_name(f".{path.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(mode=0o700, parents=True)
    except OSError as err:
        raise KeysError(f"{part}: {err.strerror}") from err
    return part.absolute()


def _make_key(path: Path) -> None:
    """Makes a private key that only its owner may read."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    curve = ("-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256")
    _openssl(path.parent, "genpkey", *curve, "-out", path.name)


def _openssl(folder: Path, *arguments: str | Path) -> None:
    try:
        done = subprocess.run(
            ["openssl", *(a if isinstance(a, str) else a.absolute() for a in arguments)],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        raise KeysError("keys are made by the command openssl: apt install openssl") from None
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if not _OPENSSL_NOISE.match(line)]
        raise KeysError(f"openssl {arguments[0]}: {'; '.join(said)}")


app = typer.Typer(
    help="Make hosts members of a team, and revoke them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Keys = Annotated[Path, typer.Option("--keys", "-k", help="Folder with the keys of the team.")]
_HERE = Path("keys")


@app.command("init")
def init_command(
    address: Annotated[str, typer.Argument(help="Where robots reach the planner's host.")],
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP port there.")] = DEFAULT_PORT,
    keys: Keys = _HERE,
) -> None:
    """Begin a team: the authority that signs, and the planner's folder."""
    TeamKeys.create(keys, address, port)
    typer.echo(f"made {keys / 'authority'}: it signs. Keep it safe, and off the robots.")
    _say({address: keys / PLANNER})


@app.command("make")
def make_command(
    names: Annotated[list[str], typer.Argument(help="Of robots or laptops, such as robot_a.")],
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
        "and there make it root's, who runs it (openvpn and iproute2 have to be installed):\n"
        f"    sudo mv {example} {ROOTS_FOLDER}\n"
        f"    sudo chown -R root:root {ROOTS_FOLDER}\n"
        f"    sudo chmod -R go-w {ROOTS_FOLDER} && sudo chmod 755 {ROOTS_FOLDER}\n"
        f"    sudo {ROOTS_FOLDER}/team up             # opens the tunnel; leave it running\n"
        f"    {ROOTS_FOLDER}/team run COMMAND ...     # runs a node, or a shell, inside it"
    )


@app.command("revoke")
def revoke_command(
    name: Annotated[str, typer.Argument(help="Of the robot that is one no more.")],
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
    from rich.table import Table

    table = Table()
    for column in ("host", "state", "ends"):
        table.add_column(column)
    now = datetime.now(timezone.utc)
    for one in TeamKeys(keys).certificates():
        days = f" ({(one.ends - now).days} days)" if one.state == "valid" else ""
        table.add_row(one.name, one.state, f"{one.ends:%Y-%m-%d}{days}")
    Console().print(table)
