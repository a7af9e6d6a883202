; The home: a robot visits points of interest and asks there whether a service is needed.
(define (domain home)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions)

  (:types
    place - object
    poi - place)

  (:constants
    anywhere - place)   ; where a robot is that stopped between two points of interest

  (:predicates
    (in_service)              ; what a problem asks for that asks for nothing else: an empty goal is no PDDL
    (robot_at ?p - place)
    (checked ?p - poi))

  (:functions
    (travel_time ?from - place ?to - poi))   ; s from one place to another

  (:durative-action navigate
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (travel_time ?from ?to))
    :condition (at start (robot_at ?from))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))))

  (:durative-action ask
    :parameters (?p - poi)
    :duration (= ?duration 5)
    :condition (over all (robot_at ?p))
    :effect (at end (checked ?p))))
