; The apartment with its four points of interest, and notes: facts that must never be lost.
(define (problem apartment)
  (:domain chaos)
  (:objects
    dorm_room bathroom kitchen main_door - poi
    n0 n1 n2 n3 n4 n5 n6 n7 n8 n9 n10 n11 n12 n13 n14 n15 n16 n17 n18 n19
    f0 f1 f2 f3 f4 f5 f6 f7 f8 f9 f10 f11 f12 f13 f14 f15 f16 f17 f18 f19 - note)
  (:init
    (robot_at anywhere)
    (= (duration anywhere dorm_room) 25)
    (= (duration anywhere bathroom) 25)
    (= (duration anywhere kitchen) 25)
    (= (duration anywhere main_door) 25)
    (= (duration dorm_room bathroom) 25)
    (= (duration dorm_room kitchen) 25)
    (= (duration dorm_room main_door) 25)
    (= (duration bathroom dorm_room) 25)
    (= (duration bathroom kitchen) 25)
    (= (duration bathroom main_door) 25)
    (= (duration kitchen dorm_room) 25)
    (= (duration kitchen bathroom) 25)
    (= (duration kitchen main_door) 25)
    (= (duration main_door dorm_room) 25)
    (= (duration main_door bathroom) 25)
    (= (duration main_door kitchen) 25))
  (:goal (and))
  (:metric minimize (total-time)))
