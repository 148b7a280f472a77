"""`mrs keys`: what it makes, who may read it, and what it refuses."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner, Result

from mrs_people_loc.errors import KeysError
from mrs_tools.cli import app
from mrs_tools.security import team_keys as module
from mrs_tools.security.team_keys import DEFAULT_PORT, PLANNER, TeamKeys

if shutil.which("openssl") is None:
    pytest.skip("keys are made by openssl, which is not here", allow_module_level=True)

ADDRESS = "192.168.1.10"


@pytest.fixture
def team(tmp_path: Path) -> TeamKeys:
    return TeamKeys.create(tmp_path / "keys", ADDRESS)


def openssl(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["openssl", *arguments], capture_output=True, text=True, check=False)


def verifies(folder: Path, authority: Path, purpose: str, crl: Path | None = None) -> bool:
    checks = ["-CRLfile", crl, "-crl_check"] if crl else []
    done = openssl(
        "verify", "-CAfile", authority, "-purpose", purpose, *checks, folder / "cert.pem"
    )
    return done.returncode == 0


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def mrs(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["keys", *map(str, arguments)], env={"COLUMNS": "150"})


# --- what is made ---------------------------------------------------------------------------------


def test_folder_of_a_host_has_no_keys_of_the_authority(team: TeamKeys) -> None:
    robot = team.make("robot_a")
    common = {"ca.pem", "cert.pem", "key.pem", "tunnel.conf", "team"}
    assert {path.name for path in robot.iterdir()} == common
    assert {path.name for path in (team.folder / PLANNER).iterdir()} == {*common, "crl.pem"}
    assert (robot / "ca.pem").read_text() == (team.folder / "authority" / "ca.pem").read_text()
    authority_key = (team.folder / "authority" / "ca.key").read_text()
    assert (robot / "key.pem").read_text() != authority_key
    assert not list(team.folder.glob(".*"))  # half-made folders


def test_certificate_matches_its_key_and_role(team: TeamKeys) -> None:
    authority = team.folder / "authority" / "ca.pem"
    robot, planner = team.make("robot_a"), team.folder / PLANNER
    for folder in (robot, planner):
        of_key = openssl("pkey", "-in", folder / "key.pem", "-pubout").stdout
        in_certificate = openssl("x509", "-in", folder / "cert.pem", "-noout", "-pubkey").stdout
        assert of_key == in_certificate != ""
    subject = openssl("x509", "-in", robot / "cert.pem", "-noout", "-subject").stdout
    assert subject.strip().replace(" ", "") == "subject=CN=robot_a"
    roles = {
        (folder.name, purpose)
        for folder in (robot, planner)
        for purpose in ("sslclient", "sslserver")
        if verifies(folder, authority, purpose)
    }
    assert roles == {("robot_a", "sslclient"), (PLANNER, "sslserver")}


def test_another_teams_certificate_does_not_verify(team: TeamKeys, tmp_path: Path) -> None:
    foreign = TeamKeys.create(tmp_path / "others", ADDRESS).make("robot_a")
    assert verifies(foreign, foreign / "ca.pem", "sslclient")
    assert not verifies(foreign, team.folder / "authority" / "ca.pem", "sslclient")


def test_only_the_owner_reads_keys(team: TeamKeys) -> None:
    robot = team.make("robot_a")
    private = [team.folder / "authority" / "ca.key", robot / "key.pem"]
    assert [mode(path) for path in private] == [0o600, 0o600]
    folders = [team.folder / "authority", robot, team.folder / PLANNER]
    assert [mode(path) for path in folders] == [0o700] * 3
    assert mode(robot / "team") & 0o100


def test_certificates_tolerate_clocks_a_day_off(team: TeamKeys) -> None:
    robot = team.make("robot_a")
    moment = datetime.now(timezone.utc) - timedelta(hours=23)
    at = ["-attime", str(int(moment.timestamp()))]
    crl = ["-CRLfile", team.folder / PLANNER / "crl.pem", "-crl_check"]
    done = openssl("verify", "-CAfile", robot / "ca.pem", *at, *crl, robot / "cert.pem")
    assert done.returncode == 0, done.stderr


def test_tunnel_leads_to_the_planner(tmp_path: Path) -> None:
    team = TeamKeys.create(tmp_path / "keys", "planner.local", 4444)
    robot = (team.make("robot_a") / "tunnel.conf").read_text().splitlines()
    planner = (team.folder / PLANNER / "tunnel.conf").read_text().splitlines()
    assert {"remote planner.local 4444", "remote-cert-tls server"} <= set(robot)
    assert "verify-x509-name planner name" in robot
    assert {"port 4444", "remote-cert-tls client", "crl-verify crl.pem"} <= set(planner)
    assert TeamKeys(team.folder).port == 4444


def test_script_is_a_valid_shell_script(team: TeamKeys) -> None:
    script = team.folder / PLANNER / "team"
    assert subprocess.run(["sh", "-n", script], check=False).returncode == 0
    done = subprocess.run(["sh", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("sudo team up ")
    assert "team run COMMAND" in done.stderr


@pytest.mark.skipif(os.getuid() != 0, reason="gives files to another user, which only root may")
@pytest.mark.parametrize("who", ["folder", "script", "key", "above"])
def test_script_writable_by_others_is_not_run_by_root(
    team: TeamKeys, tmp_path: Path, who: str
) -> None:
    """A root service in a folder of the robot's user would let that user become root."""
    folder = (tmp_path / "above" / "mrs_team").absolute()
    folder.parent.mkdir(mode=0o755)
    shutil.move(team.folder / PLANNER, folder)
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in ("ip", "openvpn"):
        (tools / name).write_text(f"#!/bin/sh\necho ran {name}\n")
        (tools / name).chmod(0o755)
    env = {"PATH": f"{tools}:/usr/sbin:/usr/bin:/sbin:/bin"}

    def up() -> subprocess.CompletedProcess[str]:
        command = ["sh", str(folder / "team"), "up"]
        return subprocess.run(command, env=env, capture_output=True, text=True, check=False)

    assert "ran openvpn" in up().stdout, up()
    place = {"folder": folder, "script": folder / "team", "key": folder / "key.pem"}
    os.chown(place.get(who, folder.parent), 1000, 1000)
    refused = up()
    assert (refused.returncode, refused.stdout) == (1, "")
    assert refused.stderr.startswith("error: root would run what others may write: ")
    assert "sudo chown -R root:root /etc/mrs_team" in refused.stderr
    os.chown(place.get(who, folder.parent), 0, 0)
    place.get(who, folder.parent).chmod(0o775)
    assert up().returncode == 1


def test_script_runs_commands_as_the_calling_user(team: TeamKeys, tmp_path: Path) -> None:
    """With an emulated sudo, which changes PATH and drops LD_LIBRARY_PATH."""
    script = tmp_path / "team"
    text = (team.folder / PLANNER / "team").read_text()
    assert "/run/netns/$netns" in text
    script.write_text(text.replace("/run/netns/$netns", "/").replace("$(id -u)", "1000"))
    sudo = tmp_path / "sudo"
    sudo.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n")
    sudo.chmod(0o755)
    env = {"PATH": f"{tmp_path}:/usr/bin:/bin", "HOME": "/home/x", "LD_LIBRARY_PATH": "/a b"}
    done = subprocess.run(
        ["sh", script, "run", "echo", "x y"], env=env, capture_output=True, text=True, check=False
    )
    words = done.stdout.splitlines()
    assert words[:5] == ["-E", "ip", "netns", "exec", "mrs"], done
    assert words[5:8] == ["setpriv", "--reuid", "1000"]
    assert words[words.index("env") :] == [
        "env", "HOME=/home/x", f"PATH={env['PATH']}", "LD_LIBRARY_PATH=/a b", "echo", "x y",
    ]  # fmt: skip


def test_folder_may_be_moved(team: TeamKeys, tmp_path: Path) -> None:
    moved = TeamKeys(team.folder.rename(tmp_path / "elsewhere"))
    assert verifies(moved.make("robot_a"), moved.folder / "authority" / "ca.pem", "sslclient")
    moved.revoke("robot_a")


def test_relative_folder_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    team = TeamKeys.create(Path("keys"), ADDRESS)
    team.make("robot_a")
    team.revoke("robot_a")
    assert (tmp_path / "keys" / PLANNER / "crl.pem").exists()


# --- revoking -------------------------------------------------------------------------------------


def test_revocation_list_has_only_the_revoked(team: TeamKeys) -> None:
    robots = {name: team.make(name) for name in ("robot_a", "robot_b")}
    authority, crl = team.folder / "authority" / "ca.pem", team.folder / PLANNER / "crl.pem"
    assert all(verifies(robot, authority, "sslclient", crl) for robot in robots.values())
    assert team.revoke("robot_a") == crl
    assert not verifies(robots["robot_a"], authority, "sslclient", crl)
    assert verifies(robots["robot_b"], authority, "sslclient", crl)
    states = {c.name: c.state for c in team.certificates()}
    assert states == {PLANNER: "valid", "robot_a": "revoked", "robot_b": "valid"}


def test_revoked_name_can_be_made_again(team: TeamKeys) -> None:
    old = team.make("robot_a")
    shutil.move(old, team.folder.parent / "old")
    with pytest.raises(KeysError, match="robot_a has a valid certificate; first: mrs keys revoke"):
        team.make("robot_a")
    crl = team.revoke("robot_a")
    new = team.make("robot_a")
    authority = team.folder / "authority" / "ca.pem"
    assert verifies(new, authority, "sslclient", crl)
    assert not verifies(team.folder.parent / "old", authority, "sslclient", crl)


def test_list_has_expiry_dates(team: TeamKeys, monkeypatch: pytest.MonkeyPatch) -> None:
    team.make("robot_a")
    left = [c.ends - datetime.now(timezone.utc) for c in team.certificates()]
    assert all(timedelta(days=729) < days <= timedelta(days=730) for days in left)
    monkeypatch.setattr(module, "_HOST_DAYS", -0.5)  # it began a day ago
    team.make("robot_b")
    assert team.certificates()[-1].state == "expired"
    monkeypatch.undo()
    shutil.rmtree(team.folder / "robot_b")
    team.make("robot_b")
    assert [c.state for c in team.certificates() if c.name == "robot_b"] == ["expired", "valid"]


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["", "Robot", "robot-a", "../x", "a b", "1a", "x" * 33, "authority", "team", "a\nb"]
)
def test_invalid_names_are_refused(team: TeamKeys, name: str) -> None:
    with pytest.raises(KeysError, match="allowed: small letters"):
        team.make(name)


@pytest.mark.parametrize("address", ["", "a b", "x\nup evil", "-x", "fe80::1", "a" * 254])
def test_invalid_addresses_are_refused(tmp_path: Path, address: str) -> None:
    with pytest.raises(KeysError, match="allowed: a host name or an IPv4 address"):
        TeamKeys.create(tmp_path / "keys", address)
    assert not (tmp_path / "keys").exists()


def test_nothing_is_overwritten(team: TeamKeys) -> None:
    robot = team.make("robot_a")
    before = (robot / "key.pem").read_bytes(), (team.folder / "authority/ca.key").read_bytes()
    with pytest.raises(KeysError, match="robot_a exists already; it is not overwritten"):
        team.make("robot_a")
    with pytest.raises(KeysError, match="authority exists already"):
        TeamKeys.create(team.folder, ADDRESS)
    after = (robot / "key.pem").read_bytes(), (team.folder / "authority/ca.key").read_bytes()
    assert before == after


def test_revoking_unknown_or_revoked_names_is_an_error(team: TeamKeys) -> None:
    team.make("robot_a")
    with pytest.raises(KeysError, match="no valid certificate for 'robot_b'; there are: planner"):
        team.revoke("robot_b")
    team.revoke("robot_a")
    for name in ("robot_a", "team"):
        with pytest.raises(KeysError, match=f"for '{name}'; there are: planner$"):
            team.revoke(name)


def test_missing_and_broken_teams_are_errors(tmp_path: Path, team: TeamKeys) -> None:
    with pytest.raises(KeysError, match="no keys of a team; make them with: mrs keys init"):
        TeamKeys(tmp_path)
    (team.folder / "authority" / "team.json").write_text("{")
    with pytest.raises(KeysError, match=r"team\.json: "):
        TeamKeys(team.folder)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"address": "a", "port": 1e999}', '{"address": "a"}', "[]", "\udc80"]
)
def test_invalid_authority_files_are_errors(team: TeamKeys, text: str) -> None:
    file = team.folder / "authority" / "team.json"
    file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(KeysError, match=r"team\.json: "):
        TeamKeys(team.folder)


@pytest.mark.parametrize("line", ["V", "V\tsoon\t\t01\tunknown\t/CN=robot_a"])
def test_invalid_certificate_entries_are_errors(team: TeamKeys, line: str) -> None:
    (team.folder / "authority" / "index.txt").write_text(line + "\n")
    with pytest.raises(KeysError, match=r"index\.txt: .* is no entry"):
        team.certificates()


def test_missing_openssl_is_reported(team: TeamKeys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(KeysError, match="apt install openssl"):
        team.make("robot_a")


def test_errors_of_openssl_are_shown(team: TeamKeys) -> None:
    (team.folder / "authority" / "ca.key").unlink()
    with pytest.raises(KeysError, match=r"openssl ca: .*ca\.key"):
        team.make("robot_a")
    assert not (team.folder / "robot_a").exists()


# --- the command ----------------------------------------------------------------------------------


def test_command(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    made = mrs("init", ADDRESS, "--keys", folder)
    assert made.exit_code == 0, made.output
    assert f"made {folder / PLANNER}" in made.output
    assert TeamKeys(folder).port == DEFAULT_PORT
    made = mrs("make", "robot_a", "robot_b", "-k", folder)
    assert made.output.count("sudo /etc/mrs_team/team up") == 1
    assert made.output.count("sudo chown -R root:root /etc/mrs_team") == 1
    assert f"scp -r {folder / 'robot_b'} robot_b:" in made.output
    revoked = mrs("revoke", "robot_b", "-k", folder)
    assert f"scp {folder / PLANNER / 'crl.pem'}" in revoked.output
    assert "begin a new team" not in revoked.output
    listed = mrs("list", "-k", folder).output
    rows = {line.split()[0]: line.split()[1] for line in listed.splitlines() if "20" in line}
    assert rows == {"planner": "valid", "robot_a": "valid", "robot_b": "revoked"}
    assert "begin a new team" in mrs("revoke", PLANNER, "-k", folder).output


def test_command_reports_errors(tmp_path: Path) -> None:
    failed = mrs("make", "robot_a", "-k", tmp_path)
    assert failed.exit_code == 1
    assert "mrs keys init ADDRESS" in failed.stderr
