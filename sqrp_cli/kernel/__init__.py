"""Surfaces, joints, cameras and states come in as arrays; sights, shares, contacts and link poses go out, compiled."""
