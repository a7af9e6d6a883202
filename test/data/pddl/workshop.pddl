; Two robots that paint and carry: parallel actions, numbers, negative and over-all conditions, a constant;
; inspect has what ROSPlan's messages cannot carry.
(define (domain workshop)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions :equality
    :disjunctive-preconditions :universal-preconditions :derived-predicates)
  (:types robot part place - object)
  (:constants store - place)
  (:predicates
    (at ?r - robot ?p - place)
    (broken ?r - robot)
    (powered)
    (painted ?x - part)
    (stored ?x - part)
    (lit ?r - robot))
  (:functions (battery ?r - robot))
  (:derived (lit ?r - robot) (and (powered) (not (broken ?r))))
  (:durative-action paint
    :parameters (?r - robot ?x - part)
    :duration (= ?duration 5)
    :condition (and
      (at start (not (broken ?r)))
      (at start (>= (battery ?r) 10))
      (over all (powered)))
    :effect (and
      (at start (decrease (battery ?r) 10))
      (at end (painted ?x))))
  (:durative-action store_part
    :parameters (?r - robot ?x - part)
    :duration (= ?duration 5)
    :condition (and
      (at start (painted ?x))
      (at start (at ?r store)))
    :effect (at end (stored ?x)))
  (:durative-action move
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration 5)
    :condition (and
      (at start (at ?r ?from))
      (at start (not (= ?from ?to))))
    :effect (and
      (at start (not (at ?r ?from)))
      (at end (at ?r ?to))))
  (:durative-action inspect
    :parameters (?r - robot ?x - part)
    :duration (= ?duration 5)
    :condition (and
      (at start (or (painted ?x) (stored ?x)))
      (over all (lit ?r))
      (over all (forall (?o - robot) (>= (battery ?o) 5))))
    :effect (at end (stored ?x))))
