; Two robots drive; notes must never be lost.
(define (domain chaos_robots)
  (:requirements :strips :typing :durative-actions)
  (:types
    robot - object
    position - object
    place - position
    note - object)
  (:constants anywhere - position)
  (:predicates
    (available ?r - robot)
    (robot_at ?r - robot ?p - position)
    (visited ?p - place)
    (noted ?n - note))
  (:durative-action drive
    :parameters (?r - robot ?from - position ?to - place)
    :duration (= ?duration 30)
    :condition (and (at start (available ?r)) (at start (robot_at ?r ?from)))
    :effect (and
      (at start (not (robot_at ?r ?from)))
      (at end (robot_at ?r ?to))
      (at end (visited ?to)))))
