; The restaurant of the SciRoc challenge: a robot checks tables, serves orders and guides new clients.
(define (domain restaurant)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions)

  (:types
    place item client - object
    poi - place
    table - poi)

  (:constants
    anywhere - place        ; where a robot is that stopped between two points of interest
    bar entrance - poi)

  (:predicates
    (robot_at ?p - place)
    (checked ?t - table)            ; its state was looked at in this round
    (needs_serving ?t - table)      ; its state is one of these four, or not known yet
    (already_served ?t - table)
    (needs_cleaning ?t - table)
    (ready ?t - table)
    (wants ?t - table ?i - item)    ; what its guest ordered
    (ordered ?t - table)            ; the robot knows the whole order
    (prepared ?t - table)           ; it stands on the bar, as ordered
    (carrying ?t - table)           ; it stands on the robot's tray
    (tray_free)
    (quiet)                         ; the robot is in no conversation
    (entrance_checked)
    (waiting ?c - client)           ; at the entrance
    (greeted ?c - client)
    (seated ?c - client))

  (:functions
    (distance ?from - place ?to - poi)  ; m, along the shortest path
    (speed)                             ; m/s, of the robot
    (pace))                             ; m/s, of a person that follows it

  (:durative-action navigate          ; each drive turns twice, about 3 s
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (+ 3 (/ (distance ?from ?to) (speed))))
    :condition (at start (robot_at ?from))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))))

  (:durative-action check_table       ; writes the state that it sees
    :parameters (?t - table)
    :duration (= ?duration 6)
    :condition (and
      (over all (quiet))
      (over all (robot_at ?t)))
    :effect (at end (checked ?t)))

  (:durative-action take_order        ; writes what is wanted
    :parameters (?t - table)
    :duration (= ?duration 15)
    :condition (and
      (at start (quiet))
      (at start (needs_serving ?t))
      (over all (robot_at ?t)))
    :effect (and
      (at start (not (quiet)))
      (at end (quiet))
      (at end (ordered ?t))))

  (:durative-action order_to_barman
    :parameters (?t - table)
    :duration (= ?duration 25)
    :condition (and
      (at start (quiet))
      (at start (ordered ?t))
      (at start (tray_free))
      (over all (robot_at bar)))
    :effect (and
      (at start (not (quiet)))
      (at end (quiet))
      (at end (prepared ?t))))

  (:durative-action load_order
    :parameters (?t - table)
    :duration (= ?duration 8)
    :condition (and
      (at start (quiet))
      (at start (prepared ?t))
      (at start (tray_free))
      (over all (robot_at bar)))
    :effect (and
      (at start (not (quiet)))
      (at end (quiet))
      (at start (not (tray_free)))
      (at end (not (prepared ?t)))
      (at end (carrying ?t))))

  (:durative-action deliver_order
    :parameters (?t - table)
    :duration (= ?duration 12)
    :condition (and
      (at start (quiet))
      (at start (carrying ?t))
      (at start (needs_serving ?t))
      (over all (robot_at ?t)))
    :effect (and
      (at start (not (quiet)))
      (at end (quiet))
      (at end (not (carrying ?t)))
      (at end (tray_free))
      (at end (not (ordered ?t)))
      (at end (not (needs_serving ?t)))
      (at end (already_served ?t))))

  (:durative-action return_order      ; its guest has left
    :parameters (?t - table)
    :duration (= ?duration 8)
    :condition (and
      (at start (quiet))
      (at start (carrying ?t))
      (over all (robot_at bar)))
    :effect (and
      (at start (not (quiet)))
      (at end (quiet))
      (at end (not (carrying ?t)))
      (at end (tray_free))))

  (:durative-action check_entrance    ; writes which clients wait there
    :parameters ()
    :duration (= ?duration 3)
    :condition (over all (robot_at entrance))
    :effect (at end (entrance_checked)))

  (:durative-action greet_client
    :parameters (?c - client)
    :duration (= ?duration 6)
    :condition (and
      (at start (waiting ?c))
      (over all (robot_at entrance)))
    :effect (at end (greeted ?c)))

  (:durative-action guide_client
    :parameters (?c - client ?t - table)
    :duration (= ?duration (/ (distance entrance ?t) (pace)))
    :condition (and
      (at start (greeted ?c))
      (at start (waiting ?c))
      (at start (robot_at entrance))
      (at start (ready ?t)))
    :effect (and
      (at start (not (robot_at entrance)))
      (at start (not (waiting ?c)))
      (at start (not (ready ?t)))
      (at end (robot_at ?t))
      (at end (seated ?c))
      (at end (needs_serving ?t)))))
