; Take an object off another one that it stands on, and carry it to the robot's home pose.
(define (domain unstack)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions)
  (:types movable fixture - object)
  (:predicates
    (hold ?object - movable)       ; the object is stuck to the tool
    (on ?object ?other - movable)  ; the object stands on the other one
    (hand_empty))                  ; the tool holds nothing
  (:action unstack
    :parameters (?object ?from - movable)
    :precondition (and (on ?object ?from) (hand_empty) (forall (?other - movable) (not (on ?other ?object))))
    :effect (and (hold ?object) (not (on ?object ?from)) (not (hand_empty)))))
