; The domain of pddl/robots with a printer, which needs no robot and prints two notes at once.
(define (domain printing_robots)
  (:requirements :strips :typing :durative-actions)
  (:types robot note position - object place - position)
  (:constants anywhere - position)
  (:predicates
    (available ?r - robot)    ; kept by the bridges: the host of the robot lives and takes actions
    (robot_at ?r - robot ?p - position)
    (visited ?p - place)
    (printed ?n - note))
  (:durative-action drive
    :parameters (?r - robot ?from - position ?to - place)
    :duration (= ?duration 30)
    :condition (and (at start (available ?r)) (at start (robot_at ?r ?from)))
    :effect (and
      (at start (not (robot_at ?r ?from)))
      (at end (robot_at ?r ?to))
      (at end (visited ?to))))
  (:durative-action print
    :parameters (?n - note)
    :duration (= ?duration 1)
    :condition ()
    :effect (at end (printed ?n))))
