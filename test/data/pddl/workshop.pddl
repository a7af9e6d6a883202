; Two robots that paint and carry: parallel actions, numbers, negative and over-all conditions, a constant.
(define (domain workshop)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions :equality)
  (:types robot part place - object)
  (:constants store - place)
  (:predicates
    (at ?r - robot ?p - place)
    (broken ?r - robot)
    (powered)
    (painted ?x - part)
    (stored ?x - part))
  (:functions (battery ?r - robot))
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
      (at end (at ?r ?to)))))
