(define (problem workshop_problem)
  (:domain workshop)
  (:objects ann bob - robot leg seat back - part bench - place)
  (:init
    (powered)
    (at ann bench) (at bob store)
    (= (battery ann) 50) (= (battery bob) 50))
  (:goal (and)))
