; Several robots visit places. The action (drive ?r ...) runs on the robot ?r; docs/several-robots.md.
(define (domain robots)
  (:requirements :strips :typing :durative-actions)
  (:types robot position - object place - position)
  (:constants anywhere - position)
  (:predicates
    (available ?r - robot)    ; kept by the bridges: the host of the robot lives and takes actions
    (robot_at ?r - robot ?p - position)
    (visited ?p - place))
  (:durative-action drive
    :parameters (?r - robot ?from - position ?to - place)
    :duration (= ?duration 30)
    :condition (and (at start (available ?r)) (at start (robot_at ?r ?from)))
    :effect (and
      (at start (not (robot_at ?r ?from)))
      (at end (robot_at ?r ?to))
      (at end (visited ?to)))))
