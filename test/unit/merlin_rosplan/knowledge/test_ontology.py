# SPDX-License-Identifier: Apache-2.0
import pytest

from merlin_pddl.domain_reader import read_domain
from merlin_pddl.knowledge import Instance
from merlin_pddl.problem_reader import read_problem
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.knowledge.ontology_command import convert

HOUSE = """
@prefix : <http://example.org/house#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:Place a owl:Class . :Poi a owl:Class ; rdfs:subClassOf :Place .
:WetPoi a owl:Class ; rdfs:subClassOf :Poi . :BathRoom a owl:Class ; owl:equivalentClass :WetPoi .
:Heated a owl:Class .
:nextTo a owl:ObjectProperty , owl:SymmetricProperty ; rdfs:domain :Place ; rdfs:range :Place .
:inside a owl:ObjectProperty , owl:TransitiveProperty .
:contains a owl:ObjectProperty ; owl:inverseOf :inside .
:kitchen a owl:NamedIndividual , :Poi ; :nextTo :hall ; :inside :flat .
:bath a :BathRoom , :Heated . :flat :inside :building . :building a owl:NamedIndividual .
"""
DOMAIN = """(define (domain house)
  (:requirements :typing)   ; a comment stays
  (:predicates (checked ?p - poi))
  (:action look :parameters (?p - poi) :effect (checked ?p)))"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "house.ttl").write_text(HOUSE)
    (tmp_path / "domain.pddl").write_text(DOMAIN)
    return tmp_path


def run(files, *options):
    return convert([str(files / "house.ttl"), str(files / "domain.pddl"), str(files / "out"), *options])


def test_ontology_answers_queries(files):
    assert run(files) == 0
    domain = read_domain(files / "out" / "domain.pddl")
    assert domain.types.subtypes("place") == {"place", "poi", "bathroom"}
    text = (files / "out" / "domain.pddl").read_text()
    assert text.index(":requirements") < text.index("a comment stays") < text.index(":types")
    store = KnowledgeStore(domain)
    store.load_problem(read_problem(files / "out" / "problem.pddl", domain))
    # the hall is a place only because something is next to it; the bath is two things at once
    assert set(store.instances("place", subtypes=True)) == {"kitchen", "hall", "bath"}
    assert store.query([Instance("place", "hall"), Instance("poi", "hall")]) == [True, False]
    assert store.query([Instance("heated", "bath"), Instance("poi", "bath")]) == [True, True]
    facts = {fact.text() for fact in store.facts()}
    assert {"(nextto hall kitchen)", "(nextto kitchen hall)"} <= facts
    assert {"(inside kitchen building)", "(contains building flat)"} <= facts


def test_any_name_of_the_file_and_a_mark_of_the_byte_order(files):
    (files / "domain.pddl").write_text("\ufeff" + DOMAIN.replace("\n", " ").replace("; a comment stays", ""))
    for name in ("our house.v2.ttl", "2026.ttl"):
        (files / "house.ttl").rename(files / name)
        assert convert([str(files / name), str(files / "domain.pddl"), str(files / "out")]) == 0
        assert read_problem(files / "out" / "problem.pddl", read_domain(files / "out" / "domain.pddl")).name
        (files / name).rename(files / "house.ttl")


def test_classes_that_are_below_each_other_are_one_type(files):
    classes = (
        ":Heated rdfs:subClassOf :Warm . :Warm owl:equivalentClass :Hot . :Hot rdfs:subClassOf :Heated ."
    )
    (files / "house.ttl").write_text(f"{HOUSE}{classes} :oven a :Hot .")
    assert run(files) == 0
    domain = read_domain(files / "out" / "domain.pddl")
    assert set(domain.types) == {"place", "poi", "bathroom", "heated"}
    assert read_problem(files / "out" / "problem.pddl", domain).objects["oven"] == ("heated",)


def test_a_class_that_a_restriction_defines_stays_a_type(files):
    restriction = "[ a owl:Restriction ; owl:onProperty :inside ; owl:someValuesFrom :Place ]"
    (files / "house.ttl").write_text(HOUSE + f":Poi owl:equivalentClass {restriction} .")
    assert run(files) == 0
    assert read_domain(files / "out" / "domain.pddl").types.subtypes("place") == {"place", "poi", "bathroom"}


def test_what_follows_from_several_axioms_together(files):
    statements = """
        :connectedTo a owl:ObjectProperty , owl:TransitiveProperty . :leadsTo a owl:ObjectProperty .
        :nextTo rdfs:subPropertyOf :connectedTo . :leadsTo owl:inverseOf :reachedFrom .
        :connectedTo rdfs:subPropertyOf :reachedFrom . :hall :nextTo :attic ."""
    (files / "house.ttl").write_text(HOUSE + statements)
    assert run(files) == 0
    problem = read_problem(files / "out" / "problem.pddl", read_domain(files / "out" / "domain.pddl"))
    facts = {fact.text() for fact in problem.facts}
    # the inverse of a transitive property, and one above a symmetric property
    assert "(contains building kitchen)" in facts
    rooms = ("kitchen", "hall", "attic")
    for name in ("connectedto", "leadsto"):
        pairs = {f"({name} {a} {b})" for a in rooms for b in rooms}
        assert {fact for fact in facts if fact.startswith(f"({name} ")} == pairs


def test_only_the_chosen_properties(files):
    assert run(files, "--property", "nextTo") == 0
    assert set(read_domain(files / "out" / "domain.pddl").predicates) == {"nextto", "checked"}


@pytest.mark.parametrize(
    "file, text, reason",
    [
        ("house.ttl", "nonsense", "is not an ontology"),
        ("house.ttl", HOUSE + ":Kitchen a owl:Class .", "have the same name in PDDL"),
        ("domain.pddl", "(define (domain", "never closed"),
    ],
)
def test_bad_input(files, capsys, file, text, reason):
    (files / file).write_text(text)
    assert run(files) == 1
    assert reason in capsys.readouterr().err
