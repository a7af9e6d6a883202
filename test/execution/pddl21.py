# SPDX-License-Identifier: Apache-2.0
"""PDDL 2.1 as the standard says it, small: what the tests of execution check with.

Nothing here comes from the planning system: text in, states out. Typed and constant objects, literals,
equality, comparisons, disjunctions, quantifiers, conditional and quantified effects, numeric effects, timed
literals and values.
"""

import itertools
import re
from typing import Any, Dict, FrozenSet, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

Tree = Any  # a word, or a list of trees
Key = Tuple[str, ...]  # of a fact or a function term
_WORD = re.compile(r"[()]|[^\s()]+")


def parse(text: str) -> List[Tree]:
    """All expressions of a text; words are lower-case."""
    stack: List[List[Tree]] = [[]]
    for word in _WORD.findall(re.sub(r";[^\n]*", "", text).lower()):
        if word == "(":
            stack.append([])
        elif word == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(word)
    assert len(stack) == 1, f"parentheses in {text}"
    return stack[0]


def typed(words: Sequence[Tree]) -> List[Tuple[str, str]]:
    """``a b - t c`` as (name, type)."""
    found: List[Tuple[str, str]] = []
    waiting: List[str] = []
    words = list(words)
    while words:
        word = words.pop(0)
        if word == "-":
            kind = words.pop(0)
            found += [(name, kind) for name in waiting]
            waiting = []
        else:
            waiting.append(word)
    return found + [(name, "object") for name in waiting]


class State:
    """What holds: facts and values."""

    def __init__(self, facts: Set[Key] = frozenset(), values: Optional[Dict[Key, float]] = None) -> None:
        self.facts = set(facts)
        self.values = dict(values or {})

    def copy(self) -> "State":
        return State(self.facts, self.values)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, State)
            and self.facts == other.facts
            and self.values.keys() == other.values.keys()
            and all(abs(value - other.values[key]) < 1e-6 for key, value in self.values.items())
        )

    def __repr__(self) -> str:
        return f"{sorted(self.facts)} {self.values}"


class Ground(NamedTuple):
    """A ground action: conditions and effects by time ("start", "all", "end") as trees with objects."""

    text: str
    durative: bool
    conditions: Dict[str, List[Tree]]
    effects: Dict[str, List[Tree]]


class Timed(NamedTuple):
    """A timed literal, or a timed value as ``(= (f) 1)``."""

    time: float
    effect: Tree


class Model:
    """A domain with its problem.

    :param domain: the sections of a domain: ``(:types …) (:action …) …``.
    :param objects: ``a b - t``.
    :param init: facts, values, timed ones.
    :param goal: one condition.
    """

    def __init__(self, domain: str, objects: str, init: str, goal: str) -> None:
        self.operators: Dict[str, Tree] = {}
        self.parents: Dict[str, str] = {}
        self.derived: List[Tuple[Tree, Tree]] = []
        self.objects = dict(typed(parse(objects)))
        for section in parse(domain):
            if section[0] in (":action", ":durative-action"):
                self.operators[section[1]] = section
            elif section[0] == ":types":
                self.parents = dict(typed(section[1:]))
            elif section[0] == ":constants":
                self.objects.update(typed(section[1:]))
            elif section[0] == ":derived":
                self.derived.append((section[1], section[2]))
        self.initial = State()
        self.timed: List[Timed] = []
        for entry in parse(init):
            if entry[0] == "at" and len(entry) == 3 and isinstance(entry[2], list):
                self.timed.append(Timed(float(entry[1]), entry[2]))
            elif entry[0] == "=":
                self.initial.values[tuple(entry[1])] = float(entry[2])
            else:
                self.initial.facts.add(tuple(entry))
        self.timed.sort()
        self.goal: Tree = (parse(goal) or [["and"]])[0]

    # --- actions --------------------------------------------------------------------------------

    def ground(self, name: str, arguments: Sequence[str]) -> Ground:
        """A ground action."""
        section = self.operators[name.lower()]
        fields = dict(zip(section[2::2], section[3::2]))
        variables = [variable for variable, _ in typed(fields.get(":parameters", []))]
        binding = dict(zip(variables, (argument.lower() for argument in arguments)))
        assert len(variables) == len(arguments), (name, arguments)
        text = "(" + " ".join([name.lower(), *(argument.lower() for argument in arguments)]) + ")"
        conditions: Dict[str, List[Tree]] = {"start": [], "all": [], "end": []}
        effects: Dict[str, List[Tree]] = {"start": [], "all": [], "end": []}
        if section[0] == ":action":
            conditions["start"] = [substitute(fields.get(":precondition", ["and"]), binding)]
            effects["start"] = [substitute(fields.get(":effect", ["and"]), binding)]
            return Ground(text, False, conditions, effects)
        for tree in conjuncts(substitute(fields.get(":condition", ["and"]), binding)):
            conditions[_time(tree)].append(tree[2])
        for tree in conjuncts(substitute(fields.get(":effect", ["and"]), binding)):
            for when, effect in _timed_effects(tree):
                effects[when].append(effect)
        return Ground(text, True, conditions, effects)

    # --- evaluation -----------------------------------------------------------------------------

    def holds(self, tree: Tree, state: State) -> bool:
        """Whether a ground condition is true."""
        if not tree:
            return True
        head = tree[0]
        if head == "and":
            return all(self.holds(part, state) for part in tree[1:])
        if head == "or":
            return any(self.holds(part, state) for part in tree[1:])
        if head == "not":
            return not self.holds(tree[1], state)
        if head == "imply":
            return not self.holds(tree[1], state) or self.holds(tree[2], state)
        if head in ("forall", "exists"):
            each = (self.holds(part, state) for part in self._instances(tree))
            return all(each) if head == "forall" else any(each)
        if head in ("<", "<=", ">", ">=") or (head == "=" and not self._are_objects(tree)):
            left, right = self.number(tree[1], state), self.number(tree[2], state)
            if left is None or right is None:
                return False
            close = abs(left - right) < 1e-9
            return {"<": left < right and not close, ">": left > right and not close}.get(
                head, close if head == "=" else close or (left < right if head == "<=" else left > right)
            )
        if head == "=":
            return bool(tree[1] == tree[2])
        return tuple(tree) in state.facts or self._follows(tree, state)

    def _are_objects(self, tree: Tree) -> bool:
        return all(isinstance(part, str) and part in self.objects for part in tree[1:])

    def _follows(self, atom: Tree, state: State) -> bool:
        """Derived predicates that do not depend on themselves."""
        for head, body in self.derived:
            variables = [variable for variable, _ in typed(head[1:])]
            if head[0] == atom[0] and self.holds(substitute(body, dict(zip(variables, atom[1:]))), state):
                return True
        return False

    def _instances(self, tree: Tree) -> Iterator[Tree]:
        variables = typed(tree[1])
        choices = [[o for o, t in self.objects.items() if self._is_a(t, kind)] for _, kind in variables]
        for objects in itertools.product(*choices):
            yield substitute(tree[2], {name: each for (name, _), each in zip(variables, objects)})

    def _is_a(self, kind: str, wanted: str) -> bool:
        while kind != wanted and kind in self.parents:
            kind = self.parents[kind]
        return kind == wanted or wanted == "object"

    def number(self, tree: Tree, state: State) -> Optional[float]:
        """The worth of a numeric expression."""
        if isinstance(tree, str):
            return float(tree)
        if tree[0] not in ("+", "-", "*", "/"):
            return state.values.get(tuple(tree))
        parts = [self.number(part, state) for part in tree[1:]]
        if any(part is None for part in parts):
            return None
        result = parts[0]
        if len(parts) == 1:
            return -result
        for part in parts[1:]:
            result = {
                "+": lambda a, b: a + b,
                "-": lambda a, b: a - b,
                "*": lambda a, b: a * b,
                "/": lambda a, b: a / b,
            }[tree[0]](result, part)
        return result

    # --- change ---------------------------------------------------------------------------------

    def apply(self, trees: Sequence[Tree], state: State) -> State:
        """The state after effects that happen together: all see the state before, deletes come first."""
        deletes: Set[Key] = set()
        adds: Set[Key] = set()
        result = state.copy()
        for effect in self._primitive(trees, state):
            if effect[0] == "not":
                deletes.add(tuple(effect[1]))
            elif effect[0] in _ASSIGNMENTS:
                key = tuple(effect[1])
                worth = self.number(effect[2], state)
                assert worth is not None, effect
                result.values[key] = _ASSIGNMENTS[effect[0]](result.values.get(key, 0.0), worth)
            elif effect[0] == "=":
                result.values[tuple(effect[1])] = float(effect[2])
            else:
                adds.add(tuple(effect))
        result.facts = (result.facts - deletes) | adds
        return result

    def _primitive(self, trees: Sequence[Tree], state: State) -> Iterator[Tree]:
        for tree in trees:
            if not tree:
                continue
            if tree[0] == "and":
                yield from self._primitive(tree[1:], state)
            elif tree[0] == "forall":
                yield from self._primitive(list(self._instances(tree)), state)
            elif tree[0] == "when":
                if self.holds(tree[1], state):
                    yield from self._primitive([tree[2]], state)
            else:
                yield tree

    # --- interference ---------------------------------------------------------------------------

    def touched(self, conditions: Sequence[Tree], effects: Sequence[Tree]) -> Tuple[FrozenSet, ...]:
        """(read, added, deleted, assigned, increased) of a happening; every branch counts."""
        read: Set[Key] = set()
        sets: Tuple[Set[Key], ...] = (read, set(), set(), set(), set())
        for tree in conditions:
            read |= self._mentioned(tree)
        self._touch(effects, sets)
        return tuple(frozenset(each) for each in sets)

    def _touch(self, trees: Sequence[Tree], sets: Tuple[Set[Key], ...]) -> None:
        read, added, deleted, assigned, increased = sets
        for tree in trees:
            if not tree:
                continue
            if tree[0] == "and":
                self._touch(tree[1:], sets)
            elif tree[0] == "forall":
                self._touch(list(self._instances(tree)), sets)
            elif tree[0] == "when":
                read |= self._mentioned(tree[1])
                self._touch([tree[2]], sets)
            elif tree[0] == "not":
                deleted.add(tuple(tree[1]))
            elif tree[0] in _ASSIGNMENTS:
                (increased if tree[0] in ("increase", "decrease") else assigned).add(tuple(tree[1]))
                read |= self._mentioned(tree[2])
            else:
                added.add(tuple(tree))

    def _mentioned(self, tree: Tree) -> Set[Key]:
        if isinstance(tree, str) or not tree:
            return set()
        if tree[0] in ("forall", "exists"):
            return {key for part in self._instances(tree) for key in self._mentioned(part)}
        if tree[0] in ("and", "or", "not", "imply", "<", "<=", ">", ">=", "=", "+", "-", "*", "/"):
            return {key for part in tree[1:] for key in self._mentioned(part)}
        found = {tuple(tree)}
        for head, body in self.derived:
            if head[0] == tree[0]:
                binding = dict(zip((variable for variable, _ in typed(head[1:])), tree[1:]))
                found |= self._mentioned(substitute(body, binding))
        return found


_ASSIGNMENTS = {
    "assign": lambda old, new: new,
    "increase": lambda old, new: old + new,
    "decrease": lambda old, new: old - new,
    "scale-up": lambda old, new: old * new,
    "scale-down": lambda old, new: old / new,
}


def substitute(tree: Tree, binding: Dict[str, str]) -> Tree:
    """A tree with objects for variables."""
    if isinstance(tree, str):
        return binding.get(tree, tree)
    return [substitute(part, binding) for part in tree]


def conjuncts(tree: Tree) -> List[Tree]:
    """The parts of a conjunction."""
    if not tree:
        return []
    return [found for part in tree[1:] for found in conjuncts(part)] if tree[0] == "and" else [tree]


def _time(tree: Tree) -> str:
    return {"at": tree[1], "over": "all"}[tree[0]]


def _timed_effects(tree: Tree) -> Iterator[Tuple[str, Tree]]:
    if tree[0] == "forall":
        for part in conjuncts(tree[2]):
            for when, effect in _timed_effects(part):
                yield when, ["forall", tree[1], effect]
    elif tree[0] == "when":
        (when, condition), (_, effect) = (_time(tree[1]), tree[1][2]), (0, tree[2][2])
        assert when == _time(tree[2]), "conditions at another time than the effect are not supported here"
        yield when, ["when", condition, effect]
    else:
        yield _time(tree), tree[2]


def interfere(first: Tuple[FrozenSet, ...], second: Tuple[FrozenSet, ...]) -> bool:
    """Whether two happenings must not come together (PDDL 2.1, definition 12)."""
    for (read, added, _, assigned, _), other in ((first, second), (second, first)):
        changed = other[1] | other[2] | other[3] | other[4]
        if read & changed or added & other[2] or assigned & (other[3] | other[4]):
            return True
    return False
