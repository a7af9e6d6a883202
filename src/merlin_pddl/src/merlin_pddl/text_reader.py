# SPDX-License-Identifier: Apache-2.0
"""Reads PDDL text into nested lists of words that know where they stand.

PDDL knows no upper case: words are lower-cased here, as ROSPlan's lexer does.
"""

import bisect
import difflib
import os
import re
import stat
import unicodedata
from typing import Iterable, Iterator, List, Optional, Tuple, Union

#: Deeper nesting than any domain needs; keeps every later recursion within Python's limit.
MAX_DEPTH = 100

#: A number, as a regular expression.
NUMBER = r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
# A dash before a letter is a token of its own, as VAL reads it: '?x -place'.
_PART = rf"{NUMBER}(?![\w.@-])|[?:]?[\w@-][\w.@-]*|#t|[<>]=?|[-+*/=^]"
_TOKEN = re.compile(
    rf"[ \t\n\r\f\v]+|;[^\n\r]*|([()])|(-(?=[A-Za-z_])|(?:{_PART})(?![^\s();]))|([^ \t\n\r\f\v();]+)",
    re.ASCII | re.IGNORECASE,
)
_PARTS = re.compile(_PART, re.ASCII | re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_\-]*\Z")
_VARIABLE = re.compile(r"\?[A-Za-z_][A-Za-z0-9_\-]*\Z")


class PddlError(Exception):
    """Something in PDDL text is wrong; the text of the error starts with ``file:line:column``."""

    def __init__(self, message: str, source: str = "", line: int = 0, column: int = 0) -> None:
        self.message = message
        self.source = source
        self.line = line
        self.column = column
        place = ":".join(str(part) for part in (source, line, column) if part)
        super().__init__(f"{place}: {message}" if place else message)


class _Placed:
    """What stands somewhere in a text; line and column count from 1."""

    source: str
    line: int
    column: int

    def error(self, message: str) -> PddlError:
        """An error at this place."""
        return PddlError(message, self.source, self.line, self.column)


class Word(str, _Placed):
    """One word of PDDL, lower-cased, and as it was written."""

    written: str

    @classmethod
    def at(cls, text: str, source: str, line: int, column: int) -> "Word":
        """Makes a word that stands at a place."""
        word = cls(text.lower())
        word.written = text
        word.source, word.line, word.column = source, line, column
        return word

    head = ""
    """As of an :class:`Expression`: a word has none."""


class Expression(List["Node"], _Placed):
    """What stands between two parentheses, with the place of the opening one."""

    def __init__(self, source: str, line: int, column: int) -> None:
        super().__init__()
        self.source = source
        self.line = line
        self.column = column

    @property
    def head(self) -> str:
        """The first word; empty when there is none."""
        return str(self[0]) if self and isinstance(self[0], Word) else ""

    def text(self) -> str:
        """The expression as PDDL on one line."""
        parts = (part.text() if isinstance(part, Expression) else str(part) for part in self)
        return f"({' '.join(parts)})"


Node = Union[Word, Expression]


def read_text(text: str, source: str = "", depth: int = MAX_DEPTH) -> List[Node]:
    """Reads all expressions of a text.

    :raises PddlError: a parenthesis is missing or too many, the nesting is absurd, or something is not a word
        of PDDL.
    """
    text = text[1:] if text.startswith("\ufeff") else text  # a mark of the byte order
    lines = line_starts(text)
    found: List[Node] = []
    open_: List[Expression] = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        assert match is not None  # the alternatives cover every character
        position = match.end()
        parenthesis, word, wrong = match.groups()
        if parenthesis is None and word is None and wrong is None:
            continue
        row = bisect.bisect_right(lines, match.start())
        column = match.start() - lines[row - 1] + 1
        if wrong is not None:
            raise PddlError(_fault(wrong), source, row, column)
        if parenthesis == "(":
            if len(open_) == depth:
                raise PddlError(f"nested deeper than {depth} parentheses", source, row, column)
            open_.append(Expression(source, row, column))
            continue
        if parenthesis == ")":
            if not open_:
                raise PddlError("this ')' closes nothing", source, row, column)
            node: Node = open_.pop()
        else:
            node = Word.at(word, source, row, column)
        (open_[-1] if open_ else found).append(node)
    if open_:
        raise open_[-1].error(f"the '(' of '({open_[-1].head}' is never closed")
    return found


def line_starts(text: str) -> List[int]:
    """Where the lines of a text begin, as the places of words count them."""
    return [0] + [match.end() for match in re.finditer(r"\r\n|\r|\n", text)]


def _fault(word: str) -> str:
    """What is wrong with what stands between two blanks and is not a word of PDDL."""
    strange = re.search(r"[^\x21-\x7e]", word)
    if strange is not None:
        sign = strange.group()
        name = f"U+{ord(sign):04X} {unicodedata.name(sign, '')}".rstrip()
        instead = "; write an ordinary blank" if sign.isspace() else ""
        return f"'{shortened(word, 40)}' has a {name}, which may stand in comments only{instead}"
    parts = _PARTS.findall(word)
    if len(parts) > 1 and "".join(parts) == word:
        return f"a blank is missing in '{shortened(word, 40)}': write '{shortened(' '.join(parts), 60)}'"
    if word in "?:":
        return f"there may be no blank between '{word}' and the name behind it"
    hint = " (a number has digits on both sides of its point)" if re.fullmatch(r"[-+.\d]+", word) else ""
    return f"'{shortened(word, 40)}' is not a word of PDDL{hint}"


def read_expression(text: str, source: str = "", depth: int = MAX_DEPTH) -> Expression:
    """Reads a text that must be exactly one expression in parentheses.

    :raises PddlError: it is something else.
    """
    nodes = read_text(text, source, depth)
    if not nodes:
        raise PddlError("there is no PDDL here", source, 1, 1)
    if not isinstance(nodes[0], Expression):
        raise nodes[0].error(f"expected '(', found '{nodes[0]}'")
    if len(nodes) > 1:
        raise nodes[1].error("nothing may follow the closing parenthesis")
    return nodes[0]


def head_of(node: Node) -> Tuple[Word, List[Node]]:
    """The name of an expression, and what is behind it.

    :raises PddlError: it is a word, or has no name.
    """
    if isinstance(node, Word):
        raise node.error(f"expected '(' before {node.written!r}")
    if not node or not isinstance(node[0], Word):
        raise node.error("an empty or nested pair of parentheses where a name is expected")
    return node[0], node[1:]


def simple_goals(node: Node) -> Iterator[Tuple[Expression, bool]]:
    """The facts and comparisons of a goal of a mission or a client, each with whether it is negated.

    :raises PddlError: it is more than a literal, a comparison, or an ``and`` of them.
    """
    head, rest = head_of(node)
    if head == "and":
        for part in rest:
            yield from simple_goals(part)
    elif head == "not":
        if len(rest) != 1:
            raise head.error("'not' takes one fact")
        # Of an 'and' that is false, one part may be true: its parts are no goals.
        if head_of(rest[0])[0] in ("and", "not", "=", "<", "<=", ">", ">="):
            raise head.error("only a plain fact can be negated")
        for part, _ in simple_goals(rest[0]):
            yield part, True
    elif head in ("or", "imply", "forall", "exists", "when", "preference"):
        raise head.error(f"{head!r} cannot stand in such a goal")
    else:
        assert isinstance(node, Expression)
        yield node, False


def read_file(path: Union[str, "os.PathLike[str]"]) -> Expression:
    """Reads a file that holds one expression.

    :raises PddlError: the file cannot be read, or holds something else.
    """
    return read_expression(text_of(path), str(path))


def text_of(path: Union[str, "os.PathLike[str]"]) -> str:
    """The text of a file, without a mark of the byte order.

    :raises PddlError: the file cannot be read, is a device, which may have no end, or is not UTF-8.
    """
    try:
        with open(path, "rb") as file:
            if stat.S_ISCHR(os.fstat(file.fileno()).st_mode):
                raise PddlError("is a device, not a file", str(path))
            data = file.read()
        return data.decode().lstrip("\ufeff")
    except UnicodeDecodeError as error:
        before = re.split(rb"\r\n|\r|\n", data[: error.start])
        raise PddlError(
            f"the byte 0x{data[error.start]:02x} is not UTF-8, in a comment neither: save the file as UTF-8",
            str(path),
            len(before),
            len(before[-1].decode(errors="replace")) + 1,
        ) from error
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        raise PddlError(f"cannot be read: {getattr(error, 'strerror', '') or error}", str(path)) from error


def is_name(text: str) -> bool:
    """Whether the text is a name in PDDL."""
    return _NAME.match(text) is not None


def name_of(node: Node, what: str) -> Word:
    """The node as a name.

    :raises PddlError: when it is something else; `what` says what was expected.
    """
    if not isinstance(node, Word):
        raise node.error(f"expected {what}, found '{node.text()[:40]}'")
    if not is_name(node):
        raise node.error(f"expected {what}, found '{node}'")
    return node


def is_variable(text: str) -> bool:
    """Whether the text is a variable in PDDL, with its question mark."""
    return _VARIABLE.match(text) is not None


def shortened(text: str, limit: int = 500) -> str:
    """A text for the log: its beginning and its end, when a client sent names without end."""
    return text if len(text) <= limit else f"{text[: limit // 2]} ... {text[-limit // 2 :]}"


def suggestion(name: str, known: Iterable[str]) -> str:
    """`` (did you mean 'x'?)`` or nothing."""
    if len(name) > 200:  # not a typing error, and comparing takes seconds
        return ""
    close: Optional[List[str]] = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""
