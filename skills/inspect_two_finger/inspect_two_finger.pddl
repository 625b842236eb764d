; Show the open fingers to the cameras for a while, from several sides, and go back to the robot's home pose.
(define (domain inspect_two_finger)
  (:requirements :strips :typing)
  (:predicates
    (open)              ; the fingers are open
    (fingers_checked))  ; the cameras have had a look at the fingers
  (:action inspect_two_finger
    :parameters ()
    :precondition (open)
    :effect (fingers_checked)))
