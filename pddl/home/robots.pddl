; The home with several robots, as domain.pddl: each action runs on the robot ?r. A place is for one robot at a time.
(define (domain home_robots)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions)

  (:types
    robot place - object
    poi - place)

  (:constants
    anywhere - place)       ; where a robot is that stopped between two points of interest

  (:predicates
    (available ?r - robot)  ; kept by the bridges: the host of the robot lives and takes actions
    (robot_at ?r - robot ?p - place)
    (free ?p - place)       ; no robot stands there or drives there
    (checked ?p - poi))

  (:functions
    (travel_time ?from - place ?to - poi))   ; s from one place to another

  (:durative-action navigate
    :parameters (?r - robot ?from - place ?to - poi)
    :duration (= ?duration (travel_time ?from ?to))
    :condition (and
      (at start (available ?r))
      (at start (robot_at ?r ?from))
      (at start (free ?to)))
    :effect (and
      (at start (not (robot_at ?r ?from)))
      (at start (free ?from))
      (at start (not (free ?to)))
      (at end (robot_at ?r ?to))))

  (:durative-action ask
    :parameters (?r - robot ?p - poi)
    :duration (= ?duration 5)
    :condition (and
      (at start (available ?r))
      (over all (robot_at ?r ?p)))
    :effect (at end (checked ?p))))
