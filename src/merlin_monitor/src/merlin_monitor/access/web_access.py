# SPDX-License-Identifier: Apache-2.0
"""Access to the page: Host, Origin, token, and the headers that bind the browser."""

import asyncio
import ipaddress
import re
import socket
import time
from typing import Callable, Dict, FrozenSet, Iterable, Mapping, NamedTuple, Optional
from urllib.parse import urlsplit

from merlin_monitor.access.operators import Operators

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
TOKEN_HEADER = "X-Merlin-Token"
LOOK_COOKIE = "merlin-look"  # begins the name of the cookie that carries a look key
_LOCAL = frozenset({"localhost", "127.0.0.1", "::1"})
_NAME = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]{0,250}[A-Za-z0-9_])?\Z")


class HostNameError(ValueError):
    """A name that no host can have, or that nobody could look from; the text says which."""


class RequestRefused(Exception):
    """A request that is refused; the text is a sentence for the client."""


class WrongToken(RequestRefused):
    """The token does not belong to an operator."""


READ_ONLY = "This monitor is read-only: it has no operators. Make one: rosrun merlin_monitor operator <name>"
NO_LOOK = "Sign in to see what the robot does."
NOBODY_LOOKS = (
    "Nobody may look yet: this page is open to other computers, and has no operators. "
    "Make one: rosrun merlin_monitor operator <name>, or let everybody look: open_look:=true"
)
OPEN_LOOK = ("open_look:=true", "--open-look")  # as an argument of a launch file, and as an option


def check_lookers(host: str, operators: bool, open_look: bool) -> None:
    """Checks that the page will be shown to a person at all.

    :param operators: whether there may be operators.
    :raises HostNameError: when nobody could ever look.
    """
    if not operators and not open_look and not is_loopback(host):
        raise HostNameError(
            f"nobody could look at the page: host:={host} opens it to other computers, and operators:=none "
            "lets nobody sign in; give operators:=FILE, or open_look:=true to show all of it to everybody"
        )


class WebAccess:
    """Decides about requests.

    :param host: address that is listened on; one that is not of this machine alone lets in requests for its
        own names and for any numeric address.
    :param names: further names under which the page may be asked for, each as the browser shows it: with a
        port where that has one. Behind a proxy, pages of these names are its own, whatever Host says.
    :param operators: those that may control the robot; without any, it is only shown.
    :param open_stop: whether everybody may stop the robot.
    :param setting: how its user gives such a name.
    :param open_look: whether everybody who reaches it may look; on an address of this machine that is so.
    :raises HostNameError: when a name is not valid.
    """

    def __init__(
        self,
        host: str,
        names: Iterable[str] = (),
        operators: Optional[Operators] = None,
        open_stop: bool = False,
        setting: str = "allowed_hosts:=",
        open_look: bool = False,
    ) -> None:
        self.open_stop = open_stop
        self._setting = setting
        self._pages = frozenset(name.lower() for name in names)
        hosts = {name: name if _is_address(name) else _host_name(name) for name in self._pages}
        for name, known in hosts.items():
            if known is None:
                raise HostNameError(f"{setting}{name} names no host; give it as robot.lab or robot.lab:8443")
        self._any_address = not is_loopback(host)
        self.open_look = open_look or not self._any_address
        """Whether everybody may look."""
        own = (socket.gethostname(), socket.getfqdn()) if self._any_address else ()
        self._names: FrozenSet[str] = _LOCAL | {
            name.lower() for name in (host, *own, *hosts.values()) if name
        }
        self._operators = operators or Operators(None)

    def check_host(self, host: Optional[str]) -> None:
        """Refuses requests meant for another name: a foreign page that had its name point here.

        :raises RequestRefused: when Host is not an allowed name.
        """
        name = _host_name(host or "")
        # A name can be made to point here, a number cannot.
        if name is None or not (name in self._names or (self._any_address and _is_address(name))):
            called = repr(name) if name else "that was asked for"
            remedy = f"; start it with {self._setting}{name}" if name else ""
            raise RequestRefused(f"This page is not served under the name {called}{remedy}.")

    def check_origin(self, origin: Optional[str], host: Optional[str]) -> None:
        """Refuses what another site's page sends. Programs send no Origin and may come in.

        :raises RequestRefused: when Origin is another site.
        """
        if origin is None:
            return
        try:
            parts = urlsplit(origin)
            site = parts.netloc.lower() if parts.scheme in ("http", "https") else ""
        except ValueError:
            site = ""
        if not site or site not in {(host or "").lower(), *self._pages}:
            raise RequestRefused(
                f"Requests from pages of other sites are refused: the page is of {site or origin!r}, "
                f"and asks {host!r}. Where a proxy stands between, have it pass on the header Host with the "
                f"port (nginx: $http_host), or start it with {self._setting}{site or 'NAME'}."
            )

    @property
    def has_operators(self) -> bool:
        """Whether anybody can sign in now."""
        return bool(self._operators.names)

    @property
    def no_look(self) -> str:
        """Why nothing is shown to those who have not signed in."""
        if self.has_operators:
            return NO_LOOK
        return NOBODY_LOOKS.replace(*OPEN_LOOK) if self._setting.startswith("--") else NOBODY_LOOKS

    def may_look(self, cookies: Mapping[str, str]) -> bool:
        """Whether what the robot does is shown to the one with these cookies."""
        keys = [value for name, value in cookies.items() if name.startswith(LOOK_COOKIE)]
        return self.open_look or self._operators.may_look(keys)

    def look_key(self, operator: str) -> str:
        """The look key of an operator; empty: none is needed."""
        return "" if self.open_look else self._operators.look_key(operator)

    def operator(self, token: Optional[str]) -> str:
        """The name of the operator who has the token.

        :raises WrongToken: when no operator has it.
        :raises RequestRefused: when no operator has it, or the monitor is read-only.
        """
        if not self._operators.names:
            raise RequestRefused(READ_ONLY)
        if not token:
            raise RequestRefused("A token is needed to control the robot.")
        name = self._operators.name_of(token)
        if name is None:
            raise WrongToken("The token is not the right one.")
        return name


def _host_name(host: str) -> Optional[str]:
    try:
        parts = urlsplit(f"//{host}")
        name = parts.hostname or ""
        _ = parts.port  # raises for a bad one
    except ValueError:
        return None
    if parts.path or parts.query or parts.fragment or "@" in host:
        return None
    return name.lower() if _NAME.match(name) or _is_address(name) else None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Whether an address to listen on is of this machine alone."""
    if host.lower() == "localhost":
        return True
    return _is_address(host) and ipaddress.ip_address(host).is_loopback


FIRST_DELAY, LONGEST_DELAY = 0.5, 3.0  # s that a wrong token is answered later; each one doubles it
FORGET = 600.0  # s after the last wrong token of an address
REPORT_EVERY = 5.0  # s between two complaints about an address
MOST_ADDRESSES = 1000


class _Address(NamedTuple):
    wrong: int
    last: float
    reported: float


class WrongTokens:
    """Counts wrong tokens by the address that they come from. For one thread, that of the server.

    :param report: takes an address and how many wrong tokens came from it, for the history and the log.
    """

    def __init__(self, report: Callable[[str, int], None]) -> None:
        self._report = report
        self._addresses: Dict[str, _Address] = {}

    async def slow_down(self, address: str) -> None:
        """Notes a wrong token, and returns when it may be answered."""
        await asyncio.sleep(self.note(address, time.monotonic()))

    def note(self, address: str, now: float) -> float:
        """Notes a wrong token.

        :param now: s of ``time.monotonic``.
        :return: s until it may be answered.
        """
        known = self._addresses.get(address, _Address(0, now, -REPORT_EVERY))
        count = 1 if now - known.last > FORGET else known.wrong + 1
        reported = known.reported
        if count == 1 or now - reported >= REPORT_EVERY:
            reported = now
            self._report(address, count)
        if len(self._addresses) >= MOST_ADDRESSES and address not in self._addresses:
            self._addresses.pop(next(iter(self._addresses)))
        self._addresses[address] = _Address(count, now, reported)
        return float(min(LONGEST_DELAY, FIRST_DELAY * 2 ** min(count - 1, 10)))
