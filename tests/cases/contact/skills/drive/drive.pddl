; Take a screw from the table and drive it into a hole.
(define (domain drive)
  (:requirements :strips :typing :negative-preconditions)
  (:types movable block - object)
  (:predicates
    (hold ?screw - movable)
    (obj_on_table ?screw - movable)
    (driven ?screw - movable)
    (ready))
  (:action drive
    :parameters (?screw - movable ?into - block)
    :precondition (and (ready) (obj_on_table ?screw) (not (hold ?screw)))
    :effect (and (driven ?screw) (not (obj_on_table ?screw)))))
