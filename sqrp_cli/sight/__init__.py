"""Where everything is comes in; what each camera sees of each box, and what hides it, goes out."""
