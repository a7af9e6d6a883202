; What a campaign needs: drive, say, listen; and actions that misbehave.
(define (domain chaos)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :durative-actions)

  (:types
    place - object
    poi - place
    note - object)

  (:constants
    anywhere - place)

  (:predicates
    (robot_at ?p - place)
    (deaf_at ?p - poi)
    (touchy_at ?p - poi)
    (plain_at ?p - poi)
    (said ?n - note)
    (heard ?n - note)
    (quitted ?n - note)
    (noted ?n - note)
    (odd)) ; the drives that misbehave may be planned

  (:functions
    (duration ?from - place ?to - poi))

  (:durative-action navigate
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (duration ?from ?to))
    :condition (at start (robot_at ?from))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))))

  ; Drives, and does not listen to a cancel.
  (:durative-action drive_deaf
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (duration ?from ?to))
    :condition (and (at start (odd)) (at start (robot_at ?from)))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))
      (at end (deaf_at ?to))))

  ; Drives, and raises an exception when it is cancelled.
  (:durative-action drive_touchy
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (duration ?from ?to))
    :condition (and (at start (odd)) (at start (robot_at ?from)))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))
      (at end (touchy_at ?to))))

  ; Drives with a client of plain actionlib.
  (:durative-action drive_plain
    :parameters (?from - place ?to - poi)
    :duration (= ?duration (duration ?from ?to))
    :condition (and (at start (odd)) (at start (robot_at ?from)))
    :effect (and
      (at start (not (robot_at ?from)))
      (at end (robot_at ?to))
      (at end (plain_at ?to))))

  (:durative-action say
    :parameters (?n - note)
    :duration (= ?duration 3)
    :effect (at end (said ?n)))

  (:durative-action hear
    :parameters (?n - note)
    :duration (= ?duration 4)
    :condition (at start (said ?n))
    :effect (at end (heard ?n)))

  ; Ends its thread with SystemExit.
  (:durative-action quit
    :parameters (?n - note)
    :duration (= ?duration 1)
    :effect (at end (quitted ?n))))
