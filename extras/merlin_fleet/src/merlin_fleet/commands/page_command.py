# SPDX-License-Identifier: Apache-2.0
"""`rosrun merlin_fleet fleet page`: serves the fleet's page until Ctrl-C."""

import argparse
import contextlib
import re
import sys

from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_fleet.page.fleet_control import FleetControl
from merlin_fleet.page.fleet_page import PANELS, FleetPage
from merlin_monitor.access.operators import Operators, OperatorsError
from merlin_monitor.access.tls import TlsError, read_tls
from merlin_monitor.access.web_access import OPEN_LOOK, WebAccess, check_lookers
from merlin_monitor.panel_scripts import script_file
from merlin_monitor.web.connections import ServerError
from merlin_monitor.web.open_command import wait_for_end
from merlin_monitor.web.web_server import WebServer


def serve(client: FleetClient, given: argparse.Namespace) -> int:
    """Serves the page until a signal ends it; returns the exit code.

    :raises FleetError: when it cannot be served.
    """
    try:
        _serve(client, given)
    except (ServerError, OperatorsError, TlsError, ValueError) as error:
        # The monitor names arguments of its launch file; those of this command are options.
        text = re.sub(r"\b(certificate|key):=", r"page-\1:=", str(error))
        text = text.replace(*OPEN_LOOK)
        raise FleetError(re.sub(r"\b([a-z-]+):=", r"--\1 ", text)) from error
    return 0


def _serve(client: FleetClient, given: argparse.Namespace) -> None:
    check_lookers(given.host, given.operators is not None, given.open_look)
    operators = Operators(given.operators)
    open_stop = not given.operators_stop
    tls = read_tls(given.page_certificate, given.page_key)
    if tls is not None and tls.warning:
        print(f"fleet page: {tls.warning}", file=sys.stderr)
    page = FleetPage(client, operators, open_stop)
    server = WebServer(
        page,
        WebAccess(
            given.host,
            given.allowed_host,
            operators,
            open_stop,
            setting="--allowed-host ",
            open_look=given.open_look,
        ),
        FleetControl(client),
        given.host,
        given.port,
        {panel["name"]: script_file(panel["script"]) for panel in PANELS},
        tls.context if tls else None,
    )
    page.start()
    try:
        server.start()
        if given.port and server.port != given.port:
            print(f"fleet page: port {given.port} is taken, using {server.port}", file=sys.stderr)
        with contextlib.suppress(KeyboardInterrupt):  # which may come before the wait begins
            print(f"{server.address}  (Ctrl-C ends it)", flush=True)
            if given.operators and not operators.names:
                print(
                    f"It only shows, since {given.operators} names no operator; "
                    "rosrun merlin_monitor operator NAME makes one, also now.",
                    flush=True,
                )
            wait_for_end(key=False)
    finally:
        server.stop()
        page.stop()
