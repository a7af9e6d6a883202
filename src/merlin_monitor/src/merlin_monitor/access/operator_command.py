"""``rosrun merlin_monitor operator ana``: makes an operator, or gives one a new token, and prints it once."""

import argparse
import os
import sys
from pathlib import Path

from merlin_monitor.access.operators import (
    OperatorsError,
    is_name,
    make_token,
    read_operators,
    write_operators,
)


def default_path() -> Path:
    """Where the launch files look for operators."""
    return Path(os.environ.get("ROS_HOME", Path.home() / ".ros")) / "merlin" / "operators.yaml"


def main() -> int:
    """Runs the command; returns the exit code."""
    parser = argparse.ArgumentParser(prog="operator", description=__doc__)
    parser.add_argument("name", help="of the operator")
    parser.add_argument("--remove", action="store_true", help="take the operator's right to control")
    parser.add_argument("--file", type=Path, default=default_path(), help="default: %(default)s")
    arguments = parser.parse_args()
    path: Path = arguments.file
    try:
        tokens = read_operators(path) if path.exists() else {}
        if arguments.remove:
            if arguments.name not in tokens:
                raise OperatorsError(f"{path} has no operator {arguments.name}")
            del tokens[arguments.name]
        elif not is_name(arguments.name):
            raise OperatorsError(f"{arguments.name!r} is not a name; use letters, digits, blanks, . - and _")
        else:
            tokens[arguments.name] = make_token()
        write_operators(path, tokens)
    except (OperatorsError, OSError) as error:
        print(f"operator: {error}", file=sys.stderr)
        return 2
    if arguments.remove:
        print(f"{arguments.name} can no longer control the robot.")
    else:
        print(f"The token of {arguments.name}, shown only now: {tokens[arguments.name]}")
    return 0
