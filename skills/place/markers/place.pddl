; Put the object between the fingers down on a surface or a tray, and go back to the robot's home pose.
(define (domain place)
  (:requirements :strips :typing)
  (:types movable fixture - object)
  (:predicates
    (hold ?object - movable)          ; the object is between the fingers
    (obj_on_table ?object - movable)  ; the object is where it was put, on something that never moves
    (open))                           ; the fingers are open
  (:action place
    :parameters (?object - movable ?onto - fixture)
    :precondition (hold ?object)
    :effect (and (obj_on_table ?object) (open) (not (hold ?object)))))
