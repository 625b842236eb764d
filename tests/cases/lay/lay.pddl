(define (domain lay)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates (hold ?object - movable) (obj_on_table ?object - movable) (hand_empty))
  (:action lay
    :parameters (?object - movable)
    :precondition (hold ?object)
    :effect (and (hand_empty) (obj_on_table ?object) (not (hold ?object)))))
