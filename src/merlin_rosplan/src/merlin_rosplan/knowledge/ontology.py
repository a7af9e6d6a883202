# SPDX-License-Identifier: Apache-2.0
"""Types, objects and facts from an OWL ontology.

Classes become types, individuals objects, and the chosen object properties predicates. What follows from
subclasses, equivalent classes, domains, ranges, subproperties, inverse, symmetric and transitive properties
is made explicit; other OWL constructs are left alone. Needs rdflib.
"""

import importlib
import re
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, List, Optional, Set, Tuple

from merlin_pddl.domain import Domain
from merlin_pddl.knowledge import Fact
from merlin_pddl.problem import Problem
from merlin_pddl.text_reader import is_name
from merlin_pddl.type_hierarchy import OBJECT, TypeHierarchy

Pair = Tuple[str, str]


class OntologyError(Exception):
    """The ontology cannot be used; the text says why."""


@dataclass
class Ontology:
    """What an ontology says, in names of PDDL."""

    types: TypeHierarchy = field(default_factory=TypeHierarchy)
    individuals: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    properties: Dict[str, Tuple[str, str]] = field(default_factory=dict)  # name -> types of both arguments
    pairs: Dict[str, List[Pair]] = field(default_factory=dict)

    def problem(self, name: str, domain: Domain) -> Problem:
        """Individuals and properties as the initial state of a problem."""
        facts = [Fact(prop, pair) for prop, pairs in self.pairs.items() for pair in pairs]
        objects = {n: types for n, types in self.individuals.items() if n not in domain.constants}
        return Problem(name, domain.name, objects, facts)

    def type_lines(self) -> List[str]:
        """The types as PDDL declares them, one per line, each with its parent."""
        lines = []
        for name in self.types:
            parents = self.types.parents(name) or (OBJECT,)
            parent = parents[0] if len(parents) == 1 else f"(either {' '.join(parents)})"
            lines.append(f"{name} - {parent}")
        return lines

    def predicate_lines(self) -> List[str]:
        """The properties as PDDL declares predicates."""
        return [f"({name} ?a - {first} ?b - {second})" for name, (first, second) in self.properties.items()]


def read_ontology(path: str, properties: Optional[Iterable[str]] = None) -> Ontology:
    """Reads an ontology (RDF/XML, Turtle, N-Triples, by the file's extension).

    :param properties: names of the object properties that become predicates; None: all.
    :raises OntologyError: rdflib is missing, the file is not an ontology, or two names become one in PDDL.
    """
    try:
        rdflib = importlib.import_module("rdflib")
    except ImportError:
        raise OntologyError("reading ontologies needs rdflib: pip install rdflib") from None
    graph = rdflib.Graph()
    formats = {".ttl": "turtle", ".nt": "nt", ".n3": "n3"}
    extension = "." + path.rsplit(".", 1)[-1].lower()
    try:
        graph.parse(path, format=formats.get(extension, "xml"))
    except OSError as error:
        raise OntologyError(f"{path} cannot be read: {error.strerror or error}") from error
    except Exception as error:  # each of rdflib's parsers has exceptions of its own
        raise OntologyError(f"{path} is not an ontology: {str(error)[:200]}") from error
    return _Reader(rdflib, graph).read(None if properties is None else {name.lower() for name in properties})


def pddl_name(text: str) -> str:
    """A text with the letters that a name of PDDL may have; it may still begin with another one."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", text).lower()


class _Reader:
    """Makes an :class:`Ontology` of an RDF graph."""

    def __init__(self, rdflib: Any, graph: Any) -> None:
        self._rdf, self._rdfs, self._owl = rdflib.RDF, rdflib.RDFS, rdflib.OWL
        self._uri = rdflib.URIRef
        self._graph = graph
        self._names: Dict[str, Any] = {}

    def read(self, wanted: Optional[Set[str]]) -> Ontology:
        found = Ontology()
        classes = self._canonical_classes()
        for node, canonical in classes.items():
            if node != canonical:
                continue
            same = [other for other, kept in classes.items() if kept == node]
            parents = {
                classes[p] for n in same for p in self._objects(n, self._rdfs.subClassOf) if p in classes
            }
            found.types.declare(self._name(node), sorted(self._name(p) for p in parents - {node}))
        found.types.complete()
        properties = self._properties(wanted)
        relations = self._relations()
        membership = self._membership(classes, relations)
        for node, names in membership.items():
            specific = found.types.most_specific(sorted(names)) or [OBJECT]
            found.individuals[self._name(node)] = tuple(specific)
        for node in properties:
            name = self._name(node)
            first = self._type_of(found.types, classes, node, self._rdfs.domain)
            second = self._type_of(found.types, classes, node, self._rdfs.range)
            found.properties[name] = (first, second)
            found.pairs[name] = sorted((self._name(a), self._name(b)) for a, b in relations[node])
        if wanted is not None and wanted - set(found.properties):
            missing = ", ".join(sorted(wanted - set(found.properties)))
            raise OntologyError(f"the ontology has no object property {missing}")
        return found

    # --- the graph --------------------------------------------------------------------------------

    def _nodes(self, kind: Any) -> List[Any]:
        return sorted(n for n in self._graph.subjects(self._rdf.type, kind) if isinstance(n, self._uri))

    def _objects(self, node: Any, relation: Any) -> List[Any]:
        return sorted(o for o in self._graph.objects(node, relation) if isinstance(o, self._uri))

    def _name(self, node: Any) -> str:
        name = pddl_name(re.split(r"[#/]", str(node))[-1])
        if not is_name(name):
            raise OntologyError(f"'{node}' does not end in a name that PDDL can have")
        if self._names.setdefault(name, node) != node:
            raise OntologyError(f"'{node}' and '{self._names[name]}' have the same name in PDDL")
        return name

    def _canonical_classes(self) -> Dict[Any, Any]:
        """All named classes but owl:Thing, each with the one that stands for its equivalents.

        Those are equivalent, too, that are below each other.
        """
        nodes = set(self._nodes(self._owl.Class)) | set(self._nodes(self._rdfs.Class))
        for first, second in self._graph.subject_objects(self._rdfs.subClassOf):
            nodes |= {node for node in (first, second) if isinstance(node, self._uri)}
        nodes.discard(self._owl.Thing)
        parents: Dict[Any, Set[Any]] = {node: set() for node in nodes}
        equivalent = list(self._graph.subject_objects(self._owl.equivalentClass))
        below = list(self._graph.subject_objects(self._rdfs.subClassOf))
        for first, second in (*equivalent, *((b, a) for a, b in equivalent), *below):
            if first in nodes and second in nodes:
                parents[first].add(second)
        above = {node: _above(node, parents) for node in nodes}
        return {node: min(other for other in above[node] if node in above[other]) for node in sorted(nodes)}

    def _properties(self, wanted: Optional[Set[str]]) -> List[Any]:
        nodes = self._nodes(self._owl.ObjectProperty)
        return [node for node in nodes if wanted is None or self._name(node) in wanted]

    def _type_of(self, types: TypeHierarchy, classes: Dict[Any, Any], node: Any, side: Any) -> str:
        named = [self._name(classes[found]) for found in self._objects(node, side) if found in classes]
        specific = types.most_specific(named)
        return specific[0] if len(specific) == 1 else OBJECT

    # --- what follows -----------------------------------------------------------------------------

    def _relations(self) -> Dict[Any, Set[Tuple[Any, Any]]]:
        """Each object property with its statements, and all that follow from those of all properties."""
        owl, graph = self._owl, self._graph
        implied: Dict[Any, Set[Tuple[Any, bool]]] = {}  # what follows from it, and whether it is turned round
        for below, above in graph.subject_objects(self._rdfs.subPropertyOf):
            implied.setdefault(below, set()).add((above, False))
        for one, other in graph.subject_objects(owl.inverseOf):
            implied.setdefault(one, set()).add((other, True))
            implied.setdefault(other, set()).add((one, True))
        for node in graph.subjects(self._rdf.type, owl.SymmetricProperty):
            implied.setdefault(node, set()).add((node, True))
        transitive = set(graph.subjects(self._rdf.type, owl.TransitiveProperty))
        found: Dict[Any, Set[Tuple[Any, Any]]] = {node: set() for node in self._nodes(owl.ObjectProperty)}
        waiting = [(node, pair) for node in {*found, *implied} for pair in graph.subject_objects(node)]
        while waiting:
            node, (a, b) = waiting.pop()
            pairs = found.setdefault(node, set())
            if (a, b) in pairs or not (isinstance(a, self._uri) and isinstance(b, self._uri)):
                continue
            pairs.add((a, b))
            waiting += [(prop, (b, a) if turned else (a, b)) for prop, turned in implied.get(node, ())]
            if node in transitive:
                waiting += [(node, (c, b)) for c, d in pairs if d == a]
                waiting += [(node, (a, d)) for c, d in pairs if c == b]
        return {node: found[node] for node in self._nodes(owl.ObjectProperty)}

    def _membership(
        self, classes: Dict[Any, Any], relations: Dict[Any, Set[Tuple[Any, Any]]]
    ) -> Dict[Any, Set[str]]:
        """Each individual with the types that are stated or follow from a property's domain and range."""
        found: Dict[Any, Set[str]] = {n: set() for n in self._nodes(self._owl.NamedIndividual)}
        for node, kind in self._graph.subject_objects(self._rdf.type):
            if kind in classes and node not in classes and isinstance(node, self._uri):
                found.setdefault(node, set()).add(self._name(classes[kind]))
        for prop, pairs in relations.items():
            for place, side in ((0, self._rdfs.domain), (1, self._rdfs.range)):
                kinds = {self._name(classes[k]) for k in self._objects(prop, side) if k in classes}
                for pair in pairs:
                    found.setdefault(pair[place], set()).update(kinds)
        return dict(sorted(found.items()))


def _above(node: Any, parents: Dict[Any, Set[Any]]) -> Set[Any]:
    """A class and all above it."""
    found, waiting = {node}, [node]
    while waiting:
        more = parents[waiting.pop()] - found
        found |= more
        waiting += more
    return found
