; Two robots in the apartment.
(define (problem apartment_of_two)
  (:domain chaos_robots)
  (:objects
    ann bob - robot
    dorm_room bathroom kitchen main_door - place
    n0 n1 n2 n3 n4 n5 n6 n7 n8 n9 n10 n11 n12 n13 n14 n15 n16 n17 n18 n19 - note)
  (:init
    (robot_at ann anywhere)
    (robot_at bob anywhere))
  (:goal (and)))
