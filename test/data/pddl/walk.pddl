; Plain actions: in ROSPlan their effects come at their start.
(define (domain walk)
  (:requirements :strips :typing)
  (:types place)
  (:constants hall kitchen cellar - place)
  (:predicates (robot_at ?p - place))
  (:action go
    :parameters (?from ?to - place)
    :precondition (robot_at ?from)
    :effect (and (not (robot_at ?from)) (robot_at ?to))))
