"""Paths of joint moves that the cameras can follow."""
