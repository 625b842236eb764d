(define (domain pickup)
  (:requirements :strips :typing :negative-preconditions)
  (:types movable fixture - object)
  (:predicates (hold ?object - movable) (on_table ?object - movable) (hand_empty))
  (:action pickup
    :parameters (?object - movable)
    :precondition (and (on_table ?object) (not (hold ?object)) (hand_empty))
    :effect (and (hold ?object) (not (on_table ?object)) (not (hand_empty)))))
