# SPDX-License-Identifier: Apache-2.0
"""Certificates of a lab: an authority of its own, the hub, the administrator, each robot and each client.

Made by `openssl`. A file that exists is never written over.
"""

import ipaddress
import os
import subprocess
import tempfile
from pathlib import Path
from typing import List, NamedTuple, Sequence

from merlin_fleet.certified import Tls
from merlin_fleet.core.records import RecordError, checked_name

AUTHORITY, HUB, ADMINISTRATOR = "ca", "hub", "root"
ROBOT, CLIENT = "robot", "client"
LONGEST = 64  # letters of a certificate's name
AUTHORITY_PARTS = "basicConstraints=critical,CA:TRUE,pathlen:0\nkeyUsage=critical,keyCertSign,cRLSign"
PARTS = "basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\nextendedKeyUsage="


class CertificateError(Exception):
    """A certificate cannot be made; the text says why."""


class Folder(NamedTuple):
    """A folder with a lab's certificates: NAME.pem and NAME.key of each."""

    path: Path

    def tls(self, name: str) -> Tls:
        """The files of one."""
        return Tls(*(str(self.path / part) for part in (f"{AUTHORITY}.pem", f"{name}.pem", f"{name}.key")))

    def names(self, kind: str) -> List[str]:
        """The robots or the clients that have a certificate here, and were not removed."""
        found = sorted(path.name[len(kind) + 1 : -4] for path in self.path.glob(f"{kind}.*.pem"))
        return [name for name in found if not self.removal(f"{kind}.{name}").exists()]

    def removal(self, name: str) -> Path:
        """The file that says that a robot or client was removed."""
        return self.path / f"{name}.removed"

    def note_removal(self, name: str) -> None:
        """Notes that a certificate has no rights any more, and is not to get them again.

        :raises CertificateError: for the name of neither a robot nor a client, or a folder that cannot be
            written.
        """
        kind, _, whose = name.partition(".")
        if kind not in (ROBOT, CLIENT):
            raise CertificateError(f"'{name}' is not {ROBOT}.NAME or {CLIENT}.NAME")
        user(kind, whose)
        try:
            self.removal(name).touch()
        except OSError as error:
            raise CertificateError(str(error)) from None

    def fleet_id(self, fleet: str) -> str:
        """The id that a fleet had in its last hub; empty: it is not noted.

        :raises CertificateError: for a note that cannot be read.
        """
        try:
            note = self._fleet_note(fleet)
            return note.read_text(encoding="utf-8").strip() if note.exists() else ""
        except (OSError, ValueError) as error:
            raise CertificateError(str(error)) from None

    def note_fleet(self, fleet: str, fleet_id: str) -> None:
        """Notes the id of a fleet, which its robots keep, for a hub that begins with nothing.

        :raises CertificateError: for a folder that cannot be written.
        """
        try:
            self._fleet_note(fleet).write_text(f"{fleet_id}\n", encoding="utf-8")
        except OSError as error:
            raise CertificateError(str(error)) from None

    def _fleet_note(self, fleet: str) -> Path:
        return self.path / f"{fleet}.fleet"


def user(kind: str, name: str) -> str:
    """Name of a robot's or client's certificate, and of its user in etcd.

    :raises CertificateError: for a name that is not allowed.
    """
    try:
        found = f"{kind}.{checked_name(name, f'the {kind}')}"
    except RecordError as error:
        raise CertificateError(str(error)) from None
    if len(found) > LONGEST:
        raise CertificateError(f"the name '{name}' is too long for a certificate")
    return found


def make_certificates(
    folder: Path, hosts: Sequence[str], robots: Sequence[str], clients: Sequence[str], days: int = 3650
) -> List[str]:
    """Makes those that are missing; returns their names.

    :param hosts: names and addresses of the hub; for the first time at least one.
    :param days: for which they are valid.
    :raises CertificateError: for a name that is not allowed, a host that the hub's certificate does not have,
        a folder that cannot be written, no openssl.
    """
    users = [user(ROBOT, name) for name in robots] + [user(CLIENT, name) for name in clients]
    wanted = {AUTHORITY: AUTHORITY_PARTS, ADMINISTRATOR: f"{PARTS}clientAuth"}
    if hosts:
        wanted[HUB] = f"{PARTS}serverAuth,clientAuth\nsubjectAltName={','.join(map(_alternative, hosts))}"
    wanted.update((name, f"{PARTS}clientAuth") for name in users)
    if not hosts and not (folder / f"{HUB}.pem").exists():
        raise CertificateError("name the hub's host, as robots and clients reach it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        missing = [name for name in wanted if not (folder / f"{name}.pem").exists()]
        if AUTHORITY in missing and len(list(folder.glob("*.pem"))):
            raise CertificateError(f"{folder} has certificates and no {AUTHORITY}.pem; use another folder")
        for host in () if HUB in missing else hosts:
            if not _is_for(folder / f"{HUB}.pem", host):
                raise CertificateError(
                    f"{folder / HUB}.pem is not for {host}; to make it for all hosts that are named, remove "
                    f"{HUB}.pem and {HUB}.key"
                )
        for name in missing:
            if Folder(folder).removal(name).exists():
                raise CertificateError(
                    f"{name} was removed: with a further certificate of this name that one has its rights "
                    f"again; use another name, or delete {Folder(folder).removal(name)}"
                )
        for name in missing:
            _make(folder, name, wanted[name], days)
    except OSError as error:
        raise CertificateError(str(error)) from None
    return missing


def _make(folder: Path, name: str, extensions: str, days: int) -> None:
    """Makes a certificate and its key; the certificate comes last, so it never exists without its key."""
    text = f"[req]\ndistinguished_name=name\nx509_extensions=parts\nprompt=no\n[name]\nCN={name}\n"
    authority = (
        [] if name == AUTHORITY else ["-CA", f"{folder}/{AUTHORITY}.pem", "-CAkey", _authority_key(folder)]
    )
    with tempfile.TemporaryDirectory(dir=str(folder), prefix=".") as scratch:  # for its owner only
        config = Path(scratch) / "config"
        config.write_text(f"{text}[parts]\n{extensions}\n", encoding="utf-8")
        command = ["openssl", "req", "-x509", "-sha256", "-days", str(days), "-config", str(config)]
        command += ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", *authority]
        command += ["-keyout", f"{scratch}/key", "-out", f"{scratch}/pem"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise CertificateError(f"openssl makes no certificate '{name}': {done.stderr.strip()}")
        os.chmod(f"{scratch}/key", 0o600)
        os.replace(f"{scratch}/key", folder / f"{name}.key")
        os.replace(f"{scratch}/pem", folder / f"{name}.pem")


def _is_for(certificate: Path, host: str) -> bool:
    check = "-checkip" if _alternative(host).startswith("IP:") else "-checkhost"
    command = ["openssl", "x509", "-noout", "-in", str(certificate), check, host]
    answer = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return " does match " in answer


def _authority_key(folder: Path) -> str:
    key = folder / f"{AUTHORITY}.key"
    if not key.exists():
        raise CertificateError(f"{key} is not here: further certificates are made where the first ones were")
    return str(key)


def _alternative(host: str) -> str:
    try:
        return f"IP:{ipaddress.ip_address(host)}"
    except ValueError:
        if not host or set(host) & set(",:=/\n "):
            raise CertificateError(f"'{host}' is not the name or the address of a host") from None
        return f"DNS:{host}"
