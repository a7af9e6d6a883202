# SPDX-License-Identifier: Apache-2.0
"""A knowledge store of a small domain, with a clock of the test's own."""

from merlin_pddl.domain_reader import parse_domain

DOMAIN = parse_domain(
    """(define (domain d)
    (:types place - object poi - place robot)
    (:constants anywhere - place)
    (:predicates (robot_at ?p - place) (near ?r - robot ?p - place) (checked ?p - poi) (idle))
    (:functions (battery ?r - robot) (limit)))"""
)


class Clock:
    now = 1_000

    def __call__(self):
        return self.now


def add(store, *items, at=0):
    with store.transaction("test") as change:
        for item in items:
            change.add(item, at)


def remove(store, *items, at=0):
    with store.transaction("test") as change:
        for item in items:
            change.remove(item, at)


def texts(rows):
    return [row.text() for row in rows]
