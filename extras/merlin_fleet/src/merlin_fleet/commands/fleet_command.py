# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin_fleet fleet`: sends, lists, cancels and follows goals, without ROS."""

import argparse
import os
import sys
from pathlib import Path
from typing import List, Optional

from merlin_fleet.certified import Tls
from merlin_fleet.commands import forget_command, keep_command
from merlin_fleet.core.clock import moment
from merlin_fleet.core.records import Goal, Report
from merlin_fleet.fleet_client import ACHIEVED, DEFAULT_FLEET, OVER, FleetClient, FleetError
from merlin_fleet.fleet_request import FleetRequest, GoalNews
from merlin_fleet.hub import DEFAULT_ENDPOINT
from merlin_monitor.access.operators import default_path
from merlin_ros.processes.option_number import option_number

EXIT_NOT_ACHIEVED = 1
EXIT_MISTAKES = 2
EXIT_INTERRUPTED = 130
LIMIT = 10.0  # s for the hub to answer


def main(arguments: Optional[List[str]] = None) -> int:
    """Runs the command; returns the exit code: 0, 1 not achieved, 2 a mistake, 130 after Ctrl-C."""
    given = _parser().parse_args(arguments)
    client = None
    try:
        client = FleetClient(given.fleet, [each for each in given.hub.split(",") if each], _tls(given))
        if not client.wait_for_hub(LIMIT):
            raise FleetError(f"no hub at {given.hub}: {client.missing}")
        return int(given.do(client, given))
    except FleetError as error:
        print(f"fleet {given.what}: {error}", file=sys.stderr)
        return EXIT_MISTAKES
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    finally:
        if client is not None:
            client.close()


def _parser() -> argparse.ArgumentParser:
    hub = argparse.ArgumentParser(add_help=False)
    hub.add_argument(
        "--hub",
        default=os.environ.get("MERLIN_FLEET_HUB", DEFAULT_ENDPOINT),
        help="host:port,host:port of etcd",
    )
    hub.add_argument(
        "--fleet", default=os.environ.get("MERLIN_FLEET", DEFAULT_FLEET), help="name of the fleet"
    )
    for name in Tls._fields:
        hub.add_argument(f"--{name}", default="", metavar="FILE", help="for a hub on another machine")
    parser = argparse.ArgumentParser(
        prog="rosrun merlin_fleet fleet",
        description="Goals of a fleet of robots. Hub and fleet: also MERLIN_FLEET_HUB and MERLIN_FLEET.",
    )
    actions = parser.add_subparsers(dest="what", required=True)
    send = actions.add_parser("send", parents=[hub], help="send a goal; prints its id")
    send.add_argument("goal", nargs="+", help='PDDL, one or many: "(checked kitchen)"')
    send.add_argument(
        "--begin-by",
        type=option_number("a number of seconds in the future", above=0.0),
        metavar="S",
        help="not begun by then, it ends as MISSED",
    )
    send.add_argument("--deadline", type=_no_deadline, help=argparse.SUPPRESS)
    send.add_argument(
        "--value", type=option_number("a number"), default=0.0, metavar="V", help="greater ones come first"
    )
    send.add_argument("--robot", default="", metavar="NAME", help="the only robot that may do it")
    send.add_argument("--group", action="append", default=[], help="for a robot of it; may be repeated")
    send.add_argument(
        "--needs", action="append", default=[], metavar="CAP", help="a capability; may be repeated"
    )
    send.add_argument("--domain", default="", help="name of the PDDL domain; robots of another one refuse it")
    send.add_argument("--finish", action="store_true", help="its owner finishes it, also without the hub")
    send.add_argument("--follow", action="store_true", help="wait for its end, as follow does")
    send.set_defaults(do=_send)
    actions.add_parser("list", parents=[hub], help="show goals and robots").set_defaults(do=_list)
    facts = actions.add_parser(
        "facts", parents=[hub], help="show the facts that robots share, and how old they are"
    )
    facts.set_defaults(do=_facts)
    for name, do, text in (
        ("cancel", _cancel, "stop a goal, wherever it is"),
        ("follow", _follow, "show what becomes of a goal, until its end; Ctrl-C ends only that"),
    ):
        action = actions.add_parser(name, parents=[hub], help=text)
        action.add_argument("id", help="of the goal")
        action.set_defaults(do=do)
    keep = actions.add_parser("keep", parents=[hub], help="remove ended goals as they get old, until Ctrl-C")
    keep_command.add_arguments(keep)
    keep.set_defaults(do=keep_command.keep)
    forget = actions.add_parser(
        "forget", parents=[hub], help="remove what a robot that never comes back has left"
    )
    forget_command.add_arguments(forget)
    forget.set_defaults(do=forget_command.forget)
    _add_page(actions.add_parser("page", parents=[hub], help="serve a page of the fleet, until Ctrl-C"))
    return parser


def _add_page(page: argparse.ArgumentParser) -> None:
    page.add_argument("--host", default="127.0.0.1", help="address to serve on (%(default)s)")
    page.add_argument(
        "--port", type=_port, default=8090, help="if it is taken, the next free one (%(default)s); 0: any"
    )
    page.add_argument(
        "--operators",
        type=_file,
        metavar="FILE",
        default=default_path(),
        help="of the operators that may send and cancel goals (%(default)s); without it the page only shows",
    )
    page.add_argument(
        "--allowed-host", action="append", default=[], metavar="NAME", help="further name of the page"
    )
    page.add_argument(
        "--open-look",
        action="store_true",
        help="with another host than this machine: everybody who reaches the page sees it without signing in",
    )
    page.add_argument(
        "--operators-stop",
        action="store_true",
        help="only operators stop robots; else everybody who reaches the page",
    )
    for name in ("certificate", "key"):
        page.add_argument(f"--page-{name}", type=_file, metavar="FILE", help="for a page by https")
    page.set_defaults(do=_page)


def _page(client: FleetClient, given: argparse.Namespace) -> int:
    from merlin_fleet.commands.page_command import serve  # the web server costs the other commands 0.3 s

    return serve(client, given)


def _file(text: str) -> Optional[Path]:
    return None if text in ("", "none") else Path(text).expanduser()


def _port(text: str) -> int:
    port = int(text) if text.isdecimal() else -1
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port: 0 to 65535")
    return port


def _no_deadline(text: str) -> float:
    raise argparse.ArgumentTypeError(
        f"a goal of a fleet is not done by a time; --begin-by {text} ends it unless it is begun then"
    )


def _tls(given: argparse.Namespace) -> Optional[Tls]:
    files = Tls(given.ca, given.certificate, given.key)
    if any(files) and not all(files):
        raise FleetError("--ca, --certificate and --key belong together")
    return files if all(files) else None


def _send(client: FleetClient, given: argparse.Namespace) -> int:
    wanted = {
        "robot": given.robot,
        "groups": tuple(given.group),
        "needs": tuple(given.needs),
        "domain": given.domain,
    }
    request = client.send(
        given.goal, value=given.value, begin_by=given.begin_by, finish=given.finish, **wanted
    )
    print(request.id, flush=True)
    prospect = client.prospect(Goal("", tuple(given.goal), 0.0, "", **wanted))
    if prospect:
        print(f"fleet send: {prospect}", file=sys.stderr)
    return follow(client, request) if given.follow else 0


def _print(text: str) -> None:
    """Prints what others have written: it is one line, and cannot move the cursor."""
    print("".join(sign if sign.isprintable() else " " for sign in text), flush=True)


def _list(client: FleetClient, _: argparse.Namespace) -> int:
    for news in client.goals():
        _print(f"{news.goal.id}  {words(news)}  {' '.join(news.goal.goals)}")
    for robot, joined in client.robots():
        _print(
            f"robot {robot.name}  {'joined' if joined else f'not joined, last seen at {moment(robot.heard)}'}"
        )
    return 0


def _facts(client: FleetClient, _: argparse.Namespace) -> int:
    robots = {robot.name: robot for robot, _ in client.robots()}
    for known, current in client.facts():
        robot = robots.get(known.robot)
        old = f"old: last seen at {moment(robot.heard)}" if robot else "old"
        _print(
            f"{known.predicate} of {known.robot}, version {known.version}  {'current' if current else old}"
        )
        for arguments in known.facts:
            _print(f"  ({' '.join([known.predicate, *arguments.split()])})")
    return 0


def _cancel(client: FleetClient, given: argparse.Namespace) -> int:
    news = client.request(given.id).news
    if news is not None and news.state in OVER:
        raise FleetError(f"'{given.id}' has ended already: {words(news)}")
    client.cancel(given.id)
    return 0


def _follow(client: FleetClient, given: argparse.Namespace) -> int:
    return follow(client, client.request(given.id))


def follow(client: FleetClient, request: FleetRequest) -> int:
    """Prints each change of a goal until it has ended; returns the exit code."""
    said = ""

    def text() -> str:
        news, report = request.news, request.result
        if report is not None:
            return _end_words(report)
        if client.missing:
            return f"without the hub: {client.missing}"
        return words(news) if news is not None else "sent"

    def changed() -> bool:
        return text() != said

    while True:
        client.wait(changed)
        said = text()
        _print(said)
        if request.result is not None:
            return 0 if request.result.outcome in ACHIEVED else EXIT_NOT_ACHIEVED


def words(news: GoalNews) -> str:
    """A goal's state in words."""
    if news.report is not None:
        return _end_words(news.report)
    if news.owner:
        return f"{news.state.value} by {news.owner}"
    why = "; ".join(f"{robot}: {reason}" for robot, reason in sorted(news.refusals.items()))
    state = f"{news.state.value}, {news.hopeless}" if news.hopeless else news.state.value
    return f"{state} ({why})" if why else state


def _end_words(report: Report) -> str:
    by = f" by {report.robot}" if report.robot else ""
    return f"{report.outcome}{by}" + (f": {report.reason}" if report.reason else "")
