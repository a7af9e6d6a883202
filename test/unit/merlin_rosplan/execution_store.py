# SPDX-License-Identifier: Apache-2.0
"""A knowledge base whose journal of executions is tried, and short words for it."""

from merlin_pddl.domain_reader import parse_domain
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.storage.state_file import StateFile

DOMAIN = parse_domain(
    """(define (domain d) (:types place) (:constants anywhere base hall - place)
    (:predicates (at ?p - place) (busy) (ready ?p - place) (asked ?p - place))
    (:functions (trips) (room))
    (:action ask :parameters (?p - place) :effect (and (asked ?p) (not (ready ?p)) (increase (trips) 1)))
    (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 1)
      :effect (and (at start (not (at ?from))) (at start (increase (trips) 2)) (at end (at ?to))))
    (:durative-action load :parameters (?p - place) :duration (= ?duration 1)
      :effect (and (at start (ready ?p)) (at start (assign (room) 4)) (at end (decrease (room) 1)))))"""
)
DRIVE = {"from": "base", "to": "hall"}
ANYWHERE = ["(at anywhere)"]


def open_store(path):
    return KnowledgeStore(DOMAIN, clock=lambda: 5, journal=StateFile(str(path), DOMAIN))


def add(store, *items):
    with store.transaction() as change:
        for item in items:
            change.add(item)


def apply(store, phase, token, *args, **more):
    with store.transaction() as change:
        return getattr(Executions(change), phase)(token, *args, **more)


def facts(store):
    return {fact.text() for fact in store.facts()}


def value(store, name):
    return store.values(name)[0].value
