"""Whether a JSGF grammar can be used, and the words in it. Pure."""

import re
from typing import Dict, List, NoReturn, Set, Tuple

_TOKEN = re.compile(
    r"(?P<blank>\s+|//[^\n]*|/\*.*?\*/)"
    r"|(?P<header>\#JSGF[^;\n]*;)"
    r"|(?P<rule><[^<>\s]+>)"
    r"|(?P<weight>/\s*[\d.]+([eE][-+]?\d+)?\s*/)"
    r"|(?P<tag>\{(?:\\.|[^\\}])*\})"
    r"|(?P<sign>[;=|*+()\[\]])"
    r'|(?P<word>"[^"\n]*"|[^\s;=|*+<>()\[\]{}/#"]+)',
    re.DOTALL,
)
_PREDEFINED = ("<NULL>", "<VOID>")
_CLOSES = {"(": ")", "[": "]"}


def check_grammar(text: str) -> List[str]:
    """Checks a grammar and returns its words.

    :raises ValueError: it is not JSGF, names a rule that it does not define, or has no public rule.
    """
    return _Grammar(text).words


class _Grammar:
    def __init__(self, text: str) -> None:
        self.words: List[str] = []
        self._text = text
        self._at = 0
        self._tokens = self._scan()
        self._rules: Dict[str, int] = {}
        self._used: Dict[str, int] = {}
        self._public = False
        imports: Set[str] = set()
        if not self._tokens or self._tokens[0][0] != "header":
            self._refuse(0, "it has to begin with '#JSGF V1.0;'")
        self._at = 1
        while self._at < len(self._tokens):
            word = self._tokens[self._at][1]
            if word == "grammar" and len(self._rules) == 0:
                self._at += 1
                self._take("word", "the name of the grammar")
            elif word == "import":
                self._at += 1
                imports.add(self._take("rule", "a rule")[1:-1].rpartition(".")[2])
            else:
                self._definition()
                continue
            self._take(";", "';'")
        if not self._public:
            self._refuse(len(text), "it has no public rule; write public <rule> = …;")
        for name, at in self._used.items():
            if name not in (*self._rules, *_PREDEFINED) and not {"*", name[1:-1]} & imports:
                there = ", ".join(self._rules)
                self._refuse(at, f"it has no rule {name}, only {there}; define it")

    def _scan(self) -> List[Tuple[str, str, int]]:
        found = []
        at = 0
        while at < len(self._text):
            match = _TOKEN.match(self._text, at)
            if match is None:
                self._refuse(at, f"{self._text[at]!r} cannot stand here")
            kind = next(name for name, part in match.groupdict().items() if part is not None)
            kind = match.group() if kind == "sign" else kind
            if kind != "blank":
                found.append((kind, match.group(), at))
            at = match.end()
        return found

    def _definition(self) -> None:
        public = self._tokens[self._at][1] == "public"
        self._at += public
        begin = self._position()
        name = self._take("rule", "a rule, <name> = …")
        if name in self._rules:
            self._refuse(begin, f"the rule {name} is defined twice")
        self._rules[name] = begin
        self._public |= public
        self._take("=", f"'=' after {name}")
        self._expansion(";", name)

    def _expansion(self, end: str, name: str) -> None:
        """Alternatives up to the sign that ends them."""
        empty = True
        while True:
            begin = self._position()
            kind, text = self._next(f"{end!r} at the end of the rule {name}")
            if kind in ("|", end):
                if empty:
                    self._refuse(begin, f"an alternative of the rule {name} is empty")
                if kind == end:
                    return
                empty = True
            elif kind in _CLOSES:
                self._expansion(_CLOSES[kind], name)
                empty = False
            elif kind in ("word", "rule"):
                if kind == "rule":
                    self._used.setdefault(text, begin)
                else:
                    self.words += text.strip('"').split()
                empty = False
            elif kind in ("*", "+", "tag") and not empty or kind == "weight":
                continue
            else:
                self._refuse(begin, f"expected {end!r} of the rule {name}, found {text!r}")

    def _position(self) -> int:
        return self._tokens[self._at][2] if self._at < len(self._tokens) else len(self._text)

    def _next(self, wanted: str) -> Tuple[str, str]:
        if self._at >= len(self._tokens):
            self._refuse(len(self._text), f"expected {wanted}")
        self._at += 1
        return self._tokens[self._at - 1][:2]

    def _take(self, kind: str, wanted: str) -> str:
        begin = self._position()
        found, text = self._next(wanted)
        if found != kind:
            self._refuse(begin, f"expected {wanted}, found {text!r}")
        return str(text)

    def _refuse(self, at: int, why: str) -> NoReturn:
        line = self._text.count("\n", 0, at) + 1
        raise ValueError(f"the grammar cannot be used, line {line}: {why}")
