"""What the cameras see: field of view, detector limits and occlusion."""
