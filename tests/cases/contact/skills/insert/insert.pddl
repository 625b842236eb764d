; Put the peg in the tool into a socket, and go back to the robot's home pose.
(define (domain insert)
  (:requirements :strips :typing)
  (:types movable socket - object)
  (:predicates
    (hold ?peg - movable)
    (inserted ?peg - movable)
    (hand_empty))
  (:action insert
    :parameters (?peg - movable ?into - socket)
    :precondition (hold ?peg)
    :effect (and (inserted ?peg) (hand_empty) (not (hold ?peg)))))
