# SPDX-License-Identifier: Apache-2.0
"""Operators of the robot: names and tokens, from a file that only its owner reads."""

import argparse
import hashlib
import hmac
import os
import re
import secrets
import sys
import threading
from pathlib import Path
from typing import Any, Dict, Iterable, List, Optional, Tuple

import yaml

SHORTEST_TOKEN = 12  # characters; a wrong one costs time, so that is out of reach for guessing
MADE_TOKEN = 12  # bytes of a token that is made
LOOK_ROUNDS = 20_000  # of a hash: a key may not lead to a token that a person has thought of
_NAME = re.compile(r"[\w][\w .-]{0,39}\Z")


class OperatorsError(ValueError):
    """The file cannot be used; the text names it and says why. Tokens are not in it."""


class Operators:
    """The operators of a file, read again when it has changed. Thread-safe.

    :param path: ``name: token`` in YAML; None: there are no operators. It need not exist yet.
    :raises OperatorsError: when the file exists and cannot be used.
    """

    def __init__(self, path: Optional[Path]) -> None:
        self._path = path
        self._lock = threading.Lock()  # guards the fields below
        self._seen: Tuple[int, ...] = ()
        self._tokens: Dict[str, str] = {}
        self._look_keys: Dict[str, str] = {}
        self.trouble = ""
        """Why the file was not taken when it was changed last; those of before stay. Empty: it was."""
        self._refresh()
        if self.trouble:
            raise OperatorsError(self.trouble)

    @property
    def names(self) -> List[str]:
        """The operators there are now."""
        self._refresh()
        with self._lock:
            return list(self._tokens)

    def name_of(self, token: str) -> Optional[str]:
        """The operator with this token, or None. All tokens are compared, so that timing reveals none."""
        self._refresh()
        given = token.encode("utf-8", "surrogatepass")
        with self._lock:
            known = [(name, own.encode("utf-8")) for name, own in self._tokens.items()]
        found = [name for name, own in known if hmac.compare_digest(given, own)]
        return found[0] if found else None

    def look_key(self, name: str) -> str:
        """What proves that a browser may look, and gives no other right; empty: no such operator."""
        with self._lock:
            return self._look_keys.get(name, "")

    def may_look(self, keys: Iterable[str]) -> bool:
        """Whether one of these is the look key of an operator that there is now."""
        self._refresh()
        given = [key.encode("utf-8", "surrogatepass") for key in keys]
        with self._lock:
            known = [key.encode() for key in self._look_keys.values()]
        return sum(hmac.compare_digest(key, own) for key in given for own in known) > 0

    def _refresh(self) -> None:
        if self._path is None:
            return
        with self._lock:
            try:
                status = os.stat(self._path)
                seen: Tuple[int, ...] = (status.st_mtime_ns, status.st_size, status.st_mode, status.st_ino)
            except FileNotFoundError:
                seen = ()
            except OSError as error:
                self.trouble = f"the operators' file {self._path} cannot be read: {error}"
                return
            if seen == self._seen:
                return
            self._seen = seen
            try:
                self._tokens = read_operators(self._path) if seen else {}
                self._look_keys = {name: _look_key(token) for name, token in self._tokens.items()}
                self.trouble = ""
            except OperatorsError as error:
                self.trouble = str(error)


def read_operators(path: Path) -> Dict[str, str]:
    """Names and tokens of a file.

    :raises OperatorsError: when it cannot be used.
    """
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OperatorsError(f"the operators' file {path} cannot be read: {error}") from error
    if mode & 0o077:
        raise OperatorsError(f"the operators' file {path} is open to others; run: chmod 600 {path}")
    try:
        found: Any = yaml.safe_load(text) or {}
    except yaml.YAMLError:  # its text would show a line, with the token
        raise OperatorsError(f"the operators' file {path} is not YAML; write name: token") from None
    if not isinstance(found, dict):
        raise OperatorsError(f"the operators' file {path} is not a list of name: token")
    for name, token in found.items():
        if not isinstance(name, str) or not _NAME.match(name):
            raise OperatorsError(f"the operators' file {path} has {name!r}, which is not a name")
        if not isinstance(token, str) or len(token) < SHORTEST_TOKEN:
            raise OperatorsError(
                f"the operators' file {path}: the token of {name} has to be a text of {SHORTEST_TOKEN} or "
                "more characters, in quotes"
            )
    if len(set(found.values())) < len(found):
        raise OperatorsError(f"the operators' file {path} gives one token to two operators")
    return found


def write_operators(path: Path, tokens: Dict[str, str]) -> None:
    """Replaces the file as a whole, readable for its owner only.

    :raises OSError: when it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.name}.{os.getpid()}")
    handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with open(handle, "w", encoding="utf-8") as file:
            yaml.safe_dump(tokens, file, allow_unicode=True)
        os.replace(new, path)
    except BaseException:
        new.unlink()
        raise


def _look_key(token: str) -> str:
    return hashlib.pbkdf2_hmac("sha256", token.encode("utf-8"), b"merlin look", LOOK_ROUNDS).hex()


def default_path() -> Path:
    """Where the launch files look for operators."""
    return Path(os.environ.get("ROS_HOME") or Path.home() / ".ros") / "merlin" / "operators.yaml"


def main() -> int:
    """Runs the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="operator", description="Makes an operator, or gives one a new token, and prints it once."
    )
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
        elif not _NAME.match(arguments.name):
            raise OperatorsError(f"{arguments.name!r} is not a name; use letters, digits, blanks, . - and _")
        else:
            tokens[arguments.name] = secrets.token_urlsafe(MADE_TOKEN)
        write_operators(path, tokens)
    except (OperatorsError, OSError) as error:
        print(f"operator: {error}", file=sys.stderr)
        return 2
    if arguments.remove:
        print(f"{arguments.name} can no longer control the robot.")
    else:
        print(f"The token of {arguments.name}, shown only now: {tokens[arguments.name]}")
    return 0
