# SPDX-License-Identifier: Apache-2.0
"""``rosrun merlin_rosplan ontology``: a domain and a problem with what an OWL ontology says."""

import argparse
import sys
from pathlib import Path
from typing import List

from merlin_pddl.domain_reader import open_definition, parse_domain
from merlin_pddl.problem_writer import write_problem
from merlin_pddl.text_reader import Expression, PddlError, is_name, line_starts, read_expression, text_of
from merlin_rosplan.knowledge.ontology import Ontology, OntologyError, pddl_name, read_ontology


def add_to_domain(text: str, source: str, ontology: Ontology) -> str:
    """A domain's text with the ontology's types and predicates before its own.

    :raises PddlError: it is not a domain.
    """
    _, sections = open_definition(read_expression(text, source), "domain")
    additions = {":types": ontology.type_lines(), ":predicates": ontology.predicate_lines()}
    first = next((section for section in sections if section.head != ":requirements"), None)
    edits = []

    def place_of(section: Expression) -> int:
        return line_starts(text)[section.line - 1] + section.column - 1

    for head, lines in additions.items():
        section = next((found for found in sections if found.head == head), None)
        body = "".join(f"\n    {line}" for line in lines)
        if section is not None:
            edits.append((place_of(section) + 1 + len(head), body))
        elif first is None:
            edits.append((text.rindex(")"), f"\n  ({head}{body})\n"))
        else:
            edits.append((place_of(first), f"({head}{body})\n  "))
    for place, addition in sorted(edits, key=lambda edit: edit[0], reverse=True):
        text = text[:place] + addition + text[place:]
    return text


def convert(arguments: List[str]) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="rosrun merlin_rosplan ontology",
        description="Writes a domain and a problem with what an OWL ontology says.",
    )
    parser.add_argument("ontology", help="OWL file: RDF/XML, Turtle or N-Triples")
    parser.add_argument("domain", help="PDDL domain that the types and predicates are added to")
    parser.add_argument("folder", help="where domain.pddl and problem.pddl are written")
    parser.add_argument(
        "--property", action="append", help="object property that becomes a predicate; default: all"
    )
    given = parser.parse_args(arguments)
    try:
        ontology = read_ontology(given.ontology, given.property)
        text = add_to_domain(text_of(given.domain), given.domain, ontology)
        folder = Path(given.folder)
        domain = parse_domain(text, str(folder / "domain.pddl"))
        name = pddl_name(Path(given.ontology).stem)
        problem = write_problem(ontology.problem(name if is_name(name) else f"of_{name}", domain), domain)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "domain.pddl").write_text(text, encoding="utf-8")
        (folder / "problem.pddl").write_text(problem, encoding="utf-8")
    except (OntologyError, PddlError, OSError, ValueError) as error:
        print(f"ontology: {error}", file=sys.stderr)
        return 1
    print(
        f"{len(list(ontology.types))} types, {len(ontology.individuals)} objects, "
        f"{len(ontology.properties)} predicates written to {folder}"
    )
    return 0


def main() -> None:
    """Entry point of ``rosrun merlin_rosplan ontology``."""
    sys.exit(convert(sys.argv[1:]))
