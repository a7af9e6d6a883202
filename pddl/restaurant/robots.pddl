; The restaurant with several robots, as domain.pddl: each action runs on the robot ?r. Places, bar and guests are shared.
(define (domain restaurant_robots)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions)

  (:types
    robot place item client - object
    poi - place
    table counter - poi)    ; a counter is a place at the bar, for one robot and one order at a time

  (:constants
    anywhere - place        ; where a robot is that stopped between two points of interest
    entrance - poi)

  (:predicates
    (available ?r - robot)  ; kept by the bridges: the host of the robot lives and takes actions
    (robot_at ?r - robot ?p - place)
    (in_position ?r - robot)        ; it has come to its place; else it was stopped beside it, and keeps it
    (free ?p - place)               ; no robot stands there or drives there
    (checked ?t - table)            ; its state was looked at in this round
    (needs_serving ?t - table)      ; its state is one of these four, or not known yet
    (already_served ?t - table)
    (needs_cleaning ?t - table)
    (ready ?t - table)
    (wants ?t - table ?i - item)    ; what its guest ordered
    (unclaimed ?t - table)          ; its guest has no waiter yet
    (waiter ?r - robot ?t - table)  ; took the order of its guest, and alone orders and delivers it
    (ordered ?t - table)            ; the robots know the whole order
    (clear ?b - counter)            ; no order stands there
    (prepared ?b - counter ?t - table)  ; it stands there, as ordered
    (carrying ?r - robot ?t - table)
    (tray_free ?r - robot)
    (quiet ?r - robot)              ; the robot is in no conversation
    (entrance_checked)
    (waiting ?c - client)           ; at the entrance
    (greeted ?r - robot ?c - client)
    (seated ?c - client))

  (:functions
    (distance ?from - place ?to - poi)  ; m, along the shortest path
    (speed)                             ; m/s, of each robot
    (pace))                             ; m/s, of a person that follows one

  (:durative-action navigate          ; each drive turns twice, about 3 s
    :parameters (?r - robot ?from - place ?to - poi)
    :duration (= ?duration (+ 3 (/ (distance ?from ?to) (speed))))
    :condition (and
      (at start (available ?r))
      (at start (robot_at ?r ?from))
      (at start (free ?to)))
    :effect (and
      (at start (not (robot_at ?r ?from)))
      (at start (not (in_position ?r)))
      (at start (free ?from))
      (at start (not (free ?to)))
      (at end (robot_at ?r ?to))
      (at end (in_position ?r))))

  (:durative-action line_up           ; the rest of a drive that was stopped beside its end
    :parameters (?r - robot ?p - poi)
    :duration (= ?duration 4)
    :condition (and
      (at start (available ?r))
      (at start (not (in_position ?r)))
      (over all (robot_at ?r ?p)))
    :effect (at end (in_position ?r)))

  (:durative-action check_table       ; writes the state that it sees; never on the way with an order
    :parameters (?r - robot ?t - table)
    :duration (= ?duration 6)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (tray_free ?r))
      (over all (quiet ?r))
      (over all (robot_at ?r ?t)))
    :effect (at end (checked ?t)))

  (:durative-action take_order        ; writes what is wanted
    :parameters (?r - robot ?t - table)
    :duration (= ?duration 15)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (needs_serving ?t))
      (at start (unclaimed ?t))
      (over all (robot_at ?r ?t)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at start (not (unclaimed ?t)))
      (at end (waiter ?r ?t))
      (at end (ordered ?t))))

  (:durative-action take_over         ; its waiter is gone; what that one carries, it keeps
    :parameters (?r - robot ?gone - robot ?t - table)
    :duration (= ?duration 3)
    :condition (and
      (at start (available ?r))
      (at start (quiet ?r))
      (at start (waiter ?gone ?t))
      (at start (not (available ?gone))))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at end (not (waiter ?gone ?t)))
      (at end (waiter ?r ?t))))

  (:durative-action order_to_barman
    :parameters (?r - robot ?b - counter ?t - table)
    :duration (= ?duration 25)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (waiter ?r ?t))
      (at start (ordered ?t))
      (at start (tray_free ?r))
      (at start (clear ?b))
      (over all (robot_at ?r ?b)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at end (not (clear ?b)))
      (at end (prepared ?b ?t))))

  (:durative-action load_order        ; also by another robot than its waiter: then it goes back
    :parameters (?r - robot ?b - counter ?t - table)
    :duration (= ?duration 8)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (prepared ?b ?t))
      (at start (tray_free ?r))
      (over all (robot_at ?r ?b)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at start (not (tray_free ?r)))
      (at end (not (prepared ?b ?t)))
      (at end (clear ?b))
      (at end (carrying ?r ?t))))

  (:durative-action deliver_order
    :parameters (?r - robot ?t - table)
    :duration (= ?duration 12)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (waiter ?r ?t))
      (at start (carrying ?r ?t))
      (at start (needs_serving ?t))
      (over all (robot_at ?r ?t)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at end (not (carrying ?r ?t)))
      (at end (tray_free ?r))
      (at end (not (waiter ?r ?t)))
      (at end (unclaimed ?t))
      (at end (not (ordered ?t)))
      (at end (not (needs_serving ?t)))
      (at end (already_served ?t))))

  (:durative-action return_order      ; its guest has left
    :parameters (?r - robot ?b - counter ?t - table)
    :duration (= ?duration 8)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (carrying ?r ?t))
      (over all (robot_at ?r ?b)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at end (not (carrying ?r ?t)))
      (at end (tray_free ?r))))

  (:durative-action check_entrance    ; writes which clients wait there
    :parameters (?r - robot)
    :duration (= ?duration 3)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (tray_free ?r))
      (over all (robot_at ?r entrance)))
    :effect (at end (entrance_checked)))

  (:durative-action greet_client
    :parameters (?r - robot ?c - client)
    :duration (= ?duration 6)
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (waiting ?c))
      (over all (robot_at ?r entrance)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at end (greeted ?r ?c))))

  (:durative-action guide_client
    :parameters (?r - robot ?c - client ?t - table)
    :duration (= ?duration (/ (distance entrance ?t) (pace)))
    :condition (and
      (at start (available ?r))
      (at start (in_position ?r))
      (at start (quiet ?r))
      (at start (greeted ?r ?c))
      (at start (waiting ?c))
      (at start (robot_at ?r entrance))
      (at start (free ?t))
      (at start (ready ?t)))
    :effect (and
      (at start (not (quiet ?r)))
      (at end (quiet ?r))
      (at start (not (robot_at ?r entrance)))
      (at start (not (in_position ?r)))
      (at start (free entrance))
      (at start (not (free ?t)))
      (at start (not (waiting ?c)))
      (at start (not (ready ?t)))
      (at end (robot_at ?r ?t))
      (at end (in_position ?r))
      (at end (seated ?c))
      (at end (needs_serving ?t)))))
