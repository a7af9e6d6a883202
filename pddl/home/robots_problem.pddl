; Two robots in the apartment with its four points of interest. Times in s: the shortest path at 0.3 m/s, and 3 s for
; turning, made by
; rosrun merlin_sim poi_distances apartment --function travel_time --from anywhere --speed 0.3 --turning 3
(define (problem apartment_robots)
  (:domain home_robots)
  (:objects
    ann bob - robot
    dorm_room bathroom kitchen main_door - poi)
  (:init
    (robot_at ann anywhere)
    (robot_at bob anywhere)
    (free dorm_room)
    (free bathroom)
    (free kitchen)
    (free main_door)
    (= (travel_time anywhere dorm_room) 27.0)
    (= (travel_time anywhere bathroom) 29.9)
    (= (travel_time anywhere kitchen) 28.2)
    (= (travel_time anywhere main_door) 28.2)
    (= (travel_time bathroom dorm_room) 29.4)
    (= (travel_time bathroom kitchen) 27.1)
    (= (travel_time bathroom main_door) 33.3)
    (= (travel_time dorm_room bathroom) 29.4)
    (= (travel_time dorm_room kitchen) 28.8)
    (= (travel_time dorm_room main_door) 22.7)
    (= (travel_time kitchen bathroom) 27.1)
    (= (travel_time kitchen dorm_room) 28.8)
    (= (travel_time kitchen main_door) 28.6)
    (= (travel_time main_door bathroom) 33.3)
    (= (travel_time main_door dorm_room) 22.7)
    (= (travel_time main_door kitchen) 28.6))
  (:goal (robot_at ann anywhere))
  (:metric minimize (total-time)))
