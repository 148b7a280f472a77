"""The keys of a team: its authority, and a folder of keys for each host."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path

from mrs_people_loc.errors import KeysError
from mrs_tools.security.openssl import (
    BEGIN,
    CONFIGURATION,
    TIME_FORMAT,
    make_key,
    period,
    run_openssl,
)
from mrs_tools.security.tunnel import PLANNER_TUNNEL, RECHECK_S, ROBOT_TUNNEL, TEAM_SCRIPT, TUNNEL

#: The host that the others connect to.
PLANNER = "planner"
DEFAULT_PORT = 5101
#: How long certificates hold [days]. A list of revoked ones that runs out would shut out everybody.
_HOST_DAYS, _TEAM_DAYS = 2 * 365, 20 * 365
_AUTHORITY_NAME = "team"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_ADDRESS = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]{0,252}")


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
        (made / "openssl.cnf").write_text(CONFIGURATION)
        (made / "team.json").write_text(json.dumps({"address": address, "port": port}) + "\n")
        make_key(made / "ca.key")
        run_openssl(
            made, "req", "-new", "-config", "openssl.cnf", "-key", "ca.key",
            "-subj", f"/CN={_AUTHORITY_NAME}", "-out", "request.pem",
        )  # fmt: skip
        run_openssl(
            made, "ca", "-batch", "-notext", "-selfsign", "-config", "openssl.cnf",
            "-in", "request.pem", "-extensions", "authority", *period(_TEAM_DAYS),
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
        make_key(made / "key.pem")
        request = made / "request.pem"
        self._openssl("ca", "-config", "openssl.cnf", "-updatedb")  # what has ended may come again
        self._openssl(
            "req", "-new", "-config", "openssl.cnf", "-key", made / "key.pem",
            "-subj", f"/CN={name}", "-out", request,
        )  # fmt: skip
        self._openssl(
            "ca", "-batch", "-notext", "-config", "openssl.cnf", "-in", request,
            "-extensions", "planner" if name == PLANNER else "robot",
            *period(_HOST_DAYS),
            "-out", made / "cert.pem",
        )  # fmt: skip
        request.unlink()
        shutil.copy(self._authority / "ca.pem", made)
        rest = PLANNER_TUNNEL if name == PLANNER else ROBOT_TUNNEL
        rest = rest.format(address=self.address, port=self.port, recheck_s=RECHECK_S)
        (made / "tunnel.conf").write_text(TUNNEL + rest)
        (made / "team").write_text(TEAM_SCRIPT)
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
                end = datetime.strptime(f"20{ends}" if len(ends) == 13 else ends, TIME_FORMAT)
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
            "ca", "-config", "openssl.cnf", "-gencrl",
            "-crl_lastupdate", f"{now - BEGIN:{TIME_FORMAT}}",
            "-crl_nextupdate", f"{now + timedelta(days=_TEAM_DAYS):{TIME_FORMAT}}", "-out", part,
        )  # fmt: skip
        part.replace(path)  # a planner on this host may read it right now
        return path

    def _openssl(self, *arguments: str | Path) -> None:
        run_openssl(self._authority, *arguments)


def _new_folder(path: Path) -> Path:
    """A new folder that is renamed to `path` once it is whole."""
    part = path.with_name(f".{path.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(mode=0o700, parents=True)
    except OSError as err:
        raise KeysError(f"{part}: {err.strerror}") from err
    return part.absolute()
