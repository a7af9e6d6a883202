# SPDX-License-Identifier: Apache-2.0
"""Whether a JSGF grammar can be used, and the words in it. Pure."""

import re
from typing import Dict, List, NoReturn

_HEADER = re.compile(r"\s*#JSGF[^;]*;")
#: Comments and tags, which may contain anything.
_ASIDE = re.compile(r"//[^\n]*|/\*.*?\*/|\{(?:\\.|[^\\}])*\}", re.DOTALL)
_RULE = re.compile(r"\s*(public\s+)?(<[^<>\s]+>)\s*=(.*)", re.DOTALL)
_IGNORED = re.compile(r"\s*(grammar\s+[\w.]+|import\s+<[\w.*]+>)?\s*")
_TOKEN = re.compile(
    r"\s*(?:(?P<ref><[^<>\s]+>)|/[\d.eE+-]+/|(?P<mark>[*+])"
    r'|(?P<sign>[|()\[\]])|(?P<word>"[^"\n]+"|[^\s;=|*+<>()\[\]{}/#"]+))'
)
_CLOSES = {"(": ")", "[": "]"}


def check_grammar(text: str) -> List[str]:
    """Checks a grammar and returns its words.

    :raises ValueError: it is not JSGF, names a rule that it does not define, or has no public rule.
    """
    # What stays has the lines that it had.
    plain = _ASIDE.sub(lambda match: "\n" * match.group().count("\n"), text)
    if not _HEADER.match(plain):
        raise ValueError("the grammar cannot be used, line 1: it has to begin with '#JSGF V1.0;'")
    *statements, rest = plain.split(";")
    words: List[str] = []
    rules: Dict[str, int] = {}
    used: Dict[str, int] = {}
    public, line = False, 1 + statements[0].count("\n")
    for statement in statements[1:]:
        match = _RULE.fullmatch(statement)
        begin = line + statement[: len(statement) - len(statement.lstrip())].count("\n")
        line += statement.count("\n")
        if match is not None:
            public = public or bool(match.group(1))
            if match.group(2) in rules:
                _refuse(begin, f"the rule {match.group(2)} is defined twice")
            rules[match.group(2)] = begin
            used.update(dict.fromkeys(_read(match.group(3), match.group(2), begin, words), begin))
        elif not _IGNORED.fullmatch(statement):
            _refuse(begin, f"expected '<rule> = …', found {' '.join(statement.split())[:40]!r}")
    if rest.strip():
        _refuse(line, f"expected ';' at its end, found {' '.join(rest.split())[-40:]!r}")
    if not public:
        _refuse(line, "it has no public rule; write public <rule> = …;")
    for name, begin in used.items():
        if name not in (*rules, "<NULL>", "<VOID>") and "import" not in plain:
            _refuse(begin, f"it has no rule {name}, only {', '.join(rules)}; define it")
    return words


def _read(body: str, rule: str, line: int, words: List[str]) -> List[str]:
    """The rules that one names; its words are added."""
    used: List[str] = []
    ends, at, empty = [""], 0, True
    body = body.rstrip()
    while at < len(body):
        match = _TOKEN.match(body, at)
        if match is None:
            _refuse(line, f"{body[at:].strip()[:1]!r} cannot stand in the rule {rule}")
        at, sign = match.end(), match.group("sign") or ""
        if sign in ("|", ")", "]"):
            if empty:
                _refuse(line, f"an alternative of the rule {rule} is empty")
            if sign != "|" and ends.pop() != sign:
                _refuse(line, f"{sign!r} closes nothing in the rule {rule}")
            empty = sign == "|"
        elif sign:
            ends.append(_CLOSES[sign])
            empty = True
        elif match.group("mark"):
            if empty:
                _refuse(line, f"{match.group('mark')!r} stands behind nothing in the rule {rule}")
        elif match.group("ref") or match.group("word"):
            used += [match.group("ref")] if match.group("ref") else []
            words += (match.group("word") or "").strip('"').split()
            empty = False
    if ends[-1]:
        _refuse(line, f"expected {ends[-1]!r} at the end of the rule {rule}")
    if empty:
        _refuse(line, f"an alternative of the rule {rule} is empty")
    return used


def _refuse(line: int, why: str) -> NoReturn:
    raise ValueError(f"the grammar cannot be used, line {line}: {why}")
