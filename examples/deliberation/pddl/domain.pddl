; A robot with one hand in a house with doors, closed containers and a battery. What it does not know is looked up:
; maybe_at says where a thing may still be, and detect is planned as if it were found there.
(define (domain deliberation)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :action-costs)

  (:types
    room thing location - object
    charger stop - location
    door spot - stop)       ; spot: where things are, on a table or in a container

  (:constants
    anywhere - location)       ; where a robot is that was stopped on its way

  (:predicates
    (in_room ?p - location ?r - room)            ; a door is within both of its rooms
    (joins ?d - door ?a ?b - room)
    (is_open ?p - stop)
    (accessible ?r - room)                   ; no closed door between the robot and this room
    (robot_at ?p - location)
    (hand_empty)
    (holding ?o - thing)
    (is_at ?o - thing ?s - spot)
    (maybe_at ?o - thing ?s - spot))         ; not looked for there yet

  (:functions
    (battery)                                ; per cent
    (drive_use ?from ?to - location)            ; of the battery, per cent
    (work_use)                               ; likewise, of any other action
    (reserve ?p - location)                     ; likewise, from there to the next charger
    (drive_cost ?from ?to - location)           ; expected tries of an action, times 100; of a drive also its length
    (hand_cost)                              ; of pick and place
    (lid_cost)                               ; of open and close
    (look_cost)
    (total-cost))

  (:action navigate
    :parameters (?from - location ?to - stop ?r - room)
    :precondition (and (robot_at ?from) (in_room ?to ?r) (accessible ?r)
      (>= (battery) (+ (drive_use ?from ?to) (reserve ?to))))
    :effect (and (not (robot_at ?from)) (robot_at ?to)
      (decrease (battery) (drive_use ?from ?to)) (increase (total-cost) (drive_cost ?from ?to))))

  ; Without a condition on the battery: where it has less than its reserve, nothing better can be done.
  (:action charge
    :parameters (?from - location ?to - charger ?r - room)
    :precondition (and (robot_at ?from) (in_room ?to ?r) (accessible ?r))
    :effect (and (not (robot_at ?from)) (robot_at ?to)
      (assign (battery) 100) (increase (total-cost) (drive_cost ?from ?to))))

  (:action open_door
    :parameters (?d - door ?a ?b - room)
    :precondition (and (robot_at ?d) (joins ?d ?a ?b) (accessible ?a) (hand_empty)
      (>= (battery) (+ (work_use) (reserve ?d))))
    :effect (and (is_open ?d) (accessible ?b)
      (decrease (battery) (work_use)) (increase (total-cost) (lid_cost))))

  (:action open
    :parameters (?s - spot)
    :precondition (and (robot_at ?s) (not (is_open ?s)) (hand_empty) (>= (battery) (+ (work_use) (reserve ?s))))
    :effect (and (is_open ?s) (decrease (battery) (work_use)) (increase (total-cost) (lid_cost))))

  (:action close
    :parameters (?s - spot)
    :precondition (and (robot_at ?s) (is_open ?s) (hand_empty) (>= (battery) (+ (work_use) (reserve ?s))))
    :effect (and (not (is_open ?s)) (decrease (battery) (work_use)) (increase (total-cost) (lid_cost))))

  (:action detect
    :parameters (?o - thing ?s - spot)
    :precondition (and (robot_at ?s) (is_open ?s) (maybe_at ?o ?s) (>= (battery) (+ (work_use) (reserve ?s))))
    :effect (and (is_at ?o ?s) (not (maybe_at ?o ?s))
      (decrease (battery) (work_use)) (increase (total-cost) (look_cost))))

  (:action pick
    :parameters (?o - thing ?s - spot)
    :precondition (and (robot_at ?s) (is_open ?s) (is_at ?o ?s) (hand_empty) (>= (battery) (+ (work_use) (reserve ?s))))
    :effect (and (holding ?o) (not (is_at ?o ?s)) (not (hand_empty))
      (decrease (battery) (work_use)) (increase (total-cost) (hand_cost))))

  (:action place
    :parameters (?o - thing ?s - spot)
    :precondition (and (robot_at ?s) (is_open ?s) (holding ?o) (>= (battery) (+ (work_use) (reserve ?s))))
    :effect (and (is_at ?o ?s) (hand_empty) (not (holding ?o))
      (decrease (battery) (work_use)) (increase (total-cost) (hand_cost)))))
