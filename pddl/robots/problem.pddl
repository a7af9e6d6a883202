; Two robots and the points of interest of the apartment.
(define (problem two_robots)
  (:domain robots)
  (:objects
    ann bob - robot
    dorm_room bathroom kitchen main_door - place)
  (:init
    (robot_at ann anywhere)
    (robot_at bob anywhere))
  (:goal (and)))
