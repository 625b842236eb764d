"""What labelled frames teach about detectors: how likely they see, by how a camera sees a box."""
