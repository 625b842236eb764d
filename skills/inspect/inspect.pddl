; Show the object in the tool to the cameras for a while, from several sides, and go back to the robot's home pose.
(define (domain inspect)
  (:requirements :strips :typing)
  (:types movable - object)
  (:predicates
    (hold ?object - movable)        ; the object is stuck to the tool
    (inspected ?object - movable))  ; the cameras have had a look at the object
  (:action inspect
    :parameters (?object - movable)
    :precondition (hold ?object)
    :effect (inspected ?object)))
