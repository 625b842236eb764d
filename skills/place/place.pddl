; Put the object in the tool down on a surface or a tray, and go back to the robot's home pose.
(define (domain place)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates
    (hold ?object - movable)          ; the object is stuck to the tool
    (obj_on_table ?object - movable)  ; the object is where it was put, on something that never moves
    (hand_empty))                     ; the tool holds nothing
  (:action place
    :parameters (?object - movable ?onto - fixture)
    :precondition (hold ?object)
    :effect (and (obj_on_table ?object) (hand_empty) (not (hold ?object)))))
