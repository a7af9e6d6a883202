# SPDX-License-Identifier: Apache-2.0
"""Whether a JSGF grammar can be used, and the words in it. Pure."""

import re
from typing import Dict, List, NoReturn

_HEADER = re.compile(r"\s*#JSGF[^;]*;")
#: Comments and tags, which may contain anything; what stays of a tag is {}.
_ASIDE = re.compile(r"//[^\n]*|/\*.*?\*/|\{(?:\\.|[^\\}])*\}", re.DOTALL)
_GRAMMAR = re.compile(r"\s*grammar\s+([\w.-]+)\s*")
_IMPORT = re.compile(r"\s*import\s*<[\w.*-]+>\s*")
_RULE = re.compile(r"\s*(public\s*)?(<[^<>\s]+>)\s*=(.*)", re.DOTALL)
_TOKEN = re.compile(
    r"\s*(?:(?P<ref><[^<>\s]+>)|(?P<weight>/(?:\d+\.?\d*|\.\d+)/)|(?P<mark>[*+])|(?P<tag>\{\})"
    r'|(?P<sign>[|()\[\]])|(?P<word>"[^"\n]+"|[^\s;=|*+<>()\[\]{}/#"]+))'
)
_CLOSES = {"(": ")", "[": "]"}


def check_grammar(text: str) -> List[str]:
    """Checks a grammar and returns its words; one in quotes is a word with its quotes.

    :raises ValueError: it is not JSGF, names a rule that it does not define, or has no public rule.
    """
    # What stays has the lines that it had.
    plain = _ASIDE.sub(
        lambda found: ("{}" if found[0][0] == "{" else " ") + "\n" * found[0].count("\n"), text
    )
    if not _HEADER.match(plain):
        raise ValueError("the grammar cannot be used, line 1: it has to begin with '#JSGF V1.0;'")
    *statements, rest = plain.split(";")
    named = _GRAMMAR.fullmatch(statements[1]) if len(statements) > 1 else None
    if named is None:
        _refuse(1 + statements[0].count("\n"), "expected 'grammar <name>;' behind '#JSGF V1.0;'")
    words: List[str] = []
    rules: Dict[str, int] = {}
    used: Dict[str, int] = {}
    public, imports, line = False, False, 1 + "".join(statements[:2]).count("\n")
    own = f"<{named.group(1)}."  # its rules may be called <grammar.rule>
    for statement in statements[2:]:
        match = _RULE.fullmatch(statement)
        begin = line + statement[: len(statement) - len(statement.lstrip())].count("\n")
        line += statement.count("\n")
        if match is not None:
            rule = match.group(2).replace(own, "<")
            if match.group(1) and "." in rule:
                _refuse(
                    begin, f"the public rule {rule} is one of another grammar; leave out the part before '.'"
                )
            public = public or bool(match.group(1))
            if rule in rules:
                _refuse(begin, f"the rule {rule} is defined twice")
            rules[rule] = begin
            read = _read(match.group(3), rule, begin, words)
            used.update((name.replace(own, "<"), begin) for name in read)
        elif _IMPORT.fullmatch(statement) and not rules:
            imports = True
        elif statement.strip():
            _refuse(begin, f"expected '<rule> = …', found {' '.join(statement.split())[:40]!r}")
    if rest.strip():
        _refuse(line, f"expected ';' at its end, found {' '.join(rest.split())[-40:]!r}")
    if not public:
        _refuse(line, "it has no public rule; write public <rule> = …;")
    for name, begin in used.items():
        if name not in (*rules, "<NULL>", "<VOID>") and not imports:
            _refuse(begin, f"it has no rule {name}, only {', '.join(rules)}; define it")
    return words


def _read(body: str, rule: str, line: int, words: List[str]) -> List[str]:
    """The rules that one names; its words are added."""
    used: List[str] = []
    ends, at = [""], 0
    last = ""  # what stands before: an item, the group of another token, or nothing in its alternative
    body = body.rstrip()
    while at < len(body):
        match = _TOKEN.match(body, at)
        if match is None:
            _refuse(line, f"{body[at:].strip()[:1]!r} cannot stand in the rule {rule}")
        at, sign, kind = match.end(), match.group("sign") or "", str(match.lastgroup)
        if last == "weight" and (kind in ("weight", "mark", "tag") or sign in ("|", ")", "]")):
            _refuse(line, f"a weight stands before nothing in the rule {rule}")
        if sign in ("|", ")", "]"):
            if not last:
                _refuse(line, f"an alternative of the rule {rule} is empty")
            if sign != "|" and ends.pop() != sign:
                _refuse(line, f"{sign!r} closes nothing in the rule {rule}")
            last = "" if sign == "|" else "item"
        elif sign:
            ends.append(_CLOSES[sign])
            last = ""
        elif kind in ("mark", "tag"):
            if not last or (last, kind) == ("tag", "mark"):
                what = repr(match.group("mark")) if kind == "mark" else "a tag"
                _refuse(line, f"{what} stands behind nothing in the rule {rule}")
            last = "item" if kind == "mark" else kind
        elif kind == "weight":
            last = kind
        else:
            (used if kind == "ref" else words).append(match.group(kind))
            last = "item"
    if ends[-1]:
        _refuse(line, f"expected {ends[-1]!r} at the end of the rule {rule}")
    if not last:
        _refuse(line, f"an alternative of the rule {rule} is empty")
    if last == "weight":
        _refuse(line, f"a weight stands before nothing in the rule {rule}")
    return used


def _refuse(line: int, why: str) -> NoReturn:
    raise ValueError(f"the grammar cannot be used, line {line}: {why}")
