(define (problem printing)
  (:domain printing_robots)
  (:objects
    ann bob carl dora - robot
    dorm_room bathroom kitchen main_door - place
    one two three - note)
  (:init
    (available ann)
    (available dora)
    (robot_at ann anywhere)
    (robot_at bob anywhere))
  (:goal (and)))
