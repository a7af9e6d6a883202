# SPDX-License-Identifier: Apache-2.0
"""The command `rosrun merlin new`."""

import argparse
import re
import sys
from pathlib import Path
from shlex import quote
from typing import List, Optional

import jinja2
import rospkg

from merlin.new.application import (
    DEFAULT_ACTION,
    ApplicationRefused,
    NewApplication,
    application_of,
    new_application,
)
from merlin.new.names import NameRefused, check_package
from merlin.new.package_writer import write_application
from merlin_pddl.text_reader import PddlError

EXIT_REFUSED = 2
#: Characters that catkin and rostest do not quote; the same as in MERLIN's own tools/build.sh.
UNQUOTED = re.compile(r"""[\s:;"'`$&()#%\\]""")


def main(arguments: Optional[List[str]] = None) -> int:
    """Writes a package; returns the exit code."""
    options = _options(arguments)
    try:
        check_package(options.name, rospkg.RosPack().list())
        application = _application(options)
        workspace = Path(options.workspace or f"{options.name}_ws").absolute()
        folder = write_application(application, workspace)
    except (NameRefused, ApplicationRefused, PddlError, OSError, jinja2.TemplateError) as error:
        print(f"merlin new: {error}", file=sys.stderr)
        return EXIT_REFUSED
    if UNQUOTED.search(str(workspace)):
        print(
            f"merlin new: warning: the path '{workspace}' has a blank, or another character with which "
            "catkin_make run_tests fails; move the workspace",
            file=sys.stderr,
        )
    print(f"{folder}: the package {application.package}, its mission and a test. Next:")
    there, python = quote(str(workspace)), quote(sys.executable)
    print(f"  cd {there} && catkin_make -DPYTHON_EXECUTABLE={python} && . devel/setup.bash")
    print(f"  rosrun merlin run {application.package} {application.package}.launch")
    print(f"  {folder / 'README.md'} says how to go on")
    return 0


def _options(arguments: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="rosrun merlin new",
        description="Writes the catkin package of a new application into a workspace of its own.",
    )
    parser.add_argument("name", help="of the package")
    parser.add_argument(
        "--action",
        action="append",
        default=[],
        metavar="TEXT",
        help=f"an operator with its parameters, as often as wanted (default: '{DEFAULT_ACTION}'); "
        "types are place, poi (a point of interest), object and those of --type",
    )
    parser.add_argument(
        "--type", action="append", default=[], metavar="TEXT", help="types: 'box tray - object'"
    )
    parser.add_argument("--from-domain", type=Path, metavar="FILE", help="a domain that exists")
    parser.add_argument(
        "--problem", type=Path, metavar="FILE", help="its problem, whose goals the mission sends"
    )
    parser.add_argument(
        "--robots",
        default="",
        metavar="NAMES",
        help="several robots in one plan: ria,tom; every operator gets its robot, also one of --from-domain "
        "that has none",
    )
    parser.add_argument("--workspace", metavar="FOLDER", help="default: NAME_ws; made when it does not exist")
    return parser.parse_args(arguments)


def _application(options: argparse.Namespace) -> NewApplication:
    robots = options.robots.replace(",", " ").split()
    if options.from_domain is None:
        if options.problem is not None:
            raise ApplicationRefused("--problem belongs to --from-domain; name the domain, too")
        return new_application(options.name, options.action, options.type, robots)
    if options.action or options.type:
        raise ApplicationRefused(
            "--from-domain has actions and types of its own; leave --action and --type out"
        )
    if options.problem is None:
        raise ApplicationRefused("--from-domain needs --problem FILE too: the mission sends its goals")
    return application_of(options.name, options.from_domain, options.problem, robots)
