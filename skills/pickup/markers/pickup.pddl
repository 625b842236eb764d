; Pick an object up from where it stands, with a gripper of two fingers, and carry it to the robot's home pose.
(define (domain pickup)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions)
  (:types movable fixture - object)
  (:predicates
    (hold ?object - movable)          ; the object is between the fingers
    (obj_on_table ?object - movable)  ; the object is where it stood when the skill began
    (on ?object ?other - movable)     ; the object stands on the other one
    (open))                           ; the fingers are open
  (:action pickup
    :parameters (?object - movable)
    :precondition (and (obj_on_table ?object) (not (hold ?object)) (open)
                       (forall (?other - movable) (not (on ?other ?object))))
    :effect (and (hold ?object) (not (obj_on_table ?object)) (not (open)))))
