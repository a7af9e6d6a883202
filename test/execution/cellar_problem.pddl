(define (problem dark) (:domain cellar)
  (:objects m1 m2 - match f1 f2 - fuse)
  (:init (unused m1) (unused m2) (free) (= (power) 3) (= (noted) 0))
  (:goal (and (mended f1) (mended f2) (= (noted) 6))))
