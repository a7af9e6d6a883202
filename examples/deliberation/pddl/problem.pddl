; The bridge writes the house of the simulation: rooms, doors, spots, things and what the robot senses.
(define (problem house)
  (:domain deliberation)
  (:init (robot_at anywhere))
  (:metric minimize (total-cost)))
