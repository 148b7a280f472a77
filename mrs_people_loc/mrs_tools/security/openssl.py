"""Keys and certificates by the `openssl` command."""

from __future__ import annotations

import os
import re
import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

from mrs_people_loc.errors import KeysError

#: They begin to hold a day before they are made: clocks of robots differ.
BEGIN = timedelta(days=1)
#: Places in openssl's own source, and what it always says.
_OPENSSL_NOISE = re.compile(r"[0-9A-F]+:error:|Using configuration from ")
TIME_FORMAT = "%Y%m%d%H%M%SZ"
CONFIGURATION = """\
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


def period(days: float) -> tuple[str, ...]:
    """From when to when a certificate holds, for `openssl ca`."""
    now = datetime.now(timezone.utc)
    end = now + timedelta(days=days)
    return "-startdate", f"{now - BEGIN:{TIME_FORMAT}}", "-enddate", f"{end:{TIME_FORMAT}}"


def make_key(path: Path) -> None:
    """Makes a private key that only its owner may read."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    curve = ("-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256")
    run_openssl(path.parent, "genpkey", *curve, "-out", path.name)


def run_openssl(folder: Path, *arguments: str | Path) -> None:
    """Runs `openssl` in a folder.

    Raises:
        KeysError: It is not installed, or fails.
    """
    try:
        done = subprocess.run(
            ["openssl", *(a if isinstance(a, str) else a.absolute() for a in arguments)],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        raise KeysError("keys are made by the command openssl: apt install openssl") from None
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if not _OPENSSL_NOISE.match(line)]
        raise KeysError(f"openssl {arguments[0]}: {'; '.join(lines)}")
