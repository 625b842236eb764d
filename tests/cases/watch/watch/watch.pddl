(define (domain watch)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates (in_place ?object - movable) (faces ?object - movable) (watched ?object - movable))
  (:action watch
    :parameters (?object - movable)
    :precondition (and (in_place ?object) (faces ?object))
    :effect (watched ?object)))
