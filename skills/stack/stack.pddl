; Put the object in the tool on top of another one, and go back to the robot's home pose.
(define (domain stack)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions :equality)
  (:types movable fixture - object)
  (:predicates
    (hold ?object - movable)       ; the object is stuck to the tool
    (on ?object ?other - movable)  ; the object stands on the other one
    (hand_empty))                  ; the tool holds nothing
  (:action stack
    :parameters (?object ?onto - movable)
    :precondition (and (hold ?object) (not (= ?object ?onto)) (forall (?other - movable) (not (on ?other ?onto))))
    :effect (and (on ?object ?onto) (hand_empty) (not (hold ?object)))))
