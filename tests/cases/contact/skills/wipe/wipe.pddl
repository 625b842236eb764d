; Wipe a surface with the sponge in the tool, and go back to the robot's home pose.
(define (domain wipe)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates
    (hold ?with - movable)
    (wiped ?surface - fixture))
  (:action wipe
    :parameters (?with - movable ?surface - fixture)
    :precondition (hold ?with)
    :effect (wiped ?surface)))
