# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin_fleet keys`: a lab's certificates, and the rights that etcd gives to them."""

import argparse
import contextlib
import sys
from pathlib import Path
from typing import Iterator, List, Optional

from merlin_fleet.certificates import (
    ADMINISTRATOR,
    CLIENT,
    ROBOT,
    CertificateError,
    Folder,
    make_certificates,
)
from merlin_fleet.certified import HubError
from merlin_fleet.core.records import RecordError
from merlin_fleet.fleet_client import DEFAULT_FLEET
from merlin_fleet.hub import DEFAULT_ENDPOINT, EtcdHub
from merlin_fleet.roles import Roles

EXIT_MISTAKES = 2
TIMEOUT = 20.0  # s for each answer of etcd, which writes all of this to its disk


def main(arguments: Optional[List[str]] = None) -> int:
    """Runs the command; returns the exit code: 0, 2 for a mistake or no hub."""
    given = _parser().parse_args(arguments)
    try:
        given.do(given)
        return 0
    except (CertificateError, RecordError, HubError) as error:
        print(f"keys {given.what}: {error}", file=sys.stderr)
        return EXIT_MISTAKES


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rosrun merlin_fleet keys", description="A lab's certificates, and what etcd allows with them."
    )
    actions = parser.add_subparsers(dest="what", required=True)
    make = actions.add_parser("make", help="make the certificates that are missing in a folder")
    make.add_argument("folder", type=Path)
    make.add_argument(
        "--host", action="append", default=[], help="name or address of the hub; may be repeated"
    )
    for kind in (ROBOT, CLIENT):
        make.add_argument(f"--{kind}", action="append", default=[], metavar="NAME", help="may be repeated")
    make.add_argument("--days", type=int, default=3650, help="for which they are valid (%(default)s)")
    make.set_defaults(do=_make)
    hub = argparse.ArgumentParser(add_help=False)
    hub.add_argument("folder", type=Path, help="with the certificates, that of the administrator too")
    hub.add_argument("--hub", default=DEFAULT_ENDPOINT, help="host:port,host:port of etcd")
    hub.add_argument("--fleet", default=DEFAULT_FLEET, help="name of the fleet")
    allow = actions.add_parser(
        "allow",
        parents=[hub],
        help="give each robot and client of the folder its rights; others keep theirs until `remove`",
    )
    allow.set_defaults(do=_allow)
    remove = actions.add_parser("remove", parents=[hub], help="take all rights from a certificate")
    remove.add_argument("name", help="robot.NAME or client.NAME")
    remove.set_defaults(do=_remove)
    return parser


def _make(given: argparse.Namespace) -> None:
    for name in make_certificates(given.folder, given.host, given.robot, given.client, given.days):
        print(given.folder / f"{name}.pem")


def _allow(given: argparse.Namespace) -> None:
    folder = Folder(given.folder)
    with _roles(given) as roles:
        known = folder.fleet_id(given.fleet)
        for name in roles.set(folder.names(ROBOT), folder.names(CLIENT), known):
            print(f"{name} has its rights in the fleet '{given.fleet}'")
        folder.note_fleet(given.fleet, roles.fleet_id())
    for path in sorted(given.folder.glob("*.removed")):
        print(f"{path.stem} was removed and gets none; to give them again, delete {path}")


def _remove(given: argparse.Namespace) -> None:
    with _roles(given) as roles:
        Folder(given.folder).note_removal(given.name)  # first: the next `allow` would give the rights again
        roles.remove(given.name)
    print(f"{given.name} no longer has rights")


@contextlib.contextmanager
def _roles(given: argparse.Namespace) -> Iterator[Roles]:
    """Roles over a connection of the administrator's, which ends with the block."""
    tls, endpoints = Folder(given.folder).tls(ADMINISTRATOR), [each for each in given.hub.split(",") if each]
    with contextlib.closing(EtcdHub("/merlin/", endpoints, tls, TIMEOUT)) as hub:
        yield Roles(hub, given.fleet)
