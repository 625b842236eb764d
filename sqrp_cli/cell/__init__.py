"""A cell, read once: robot, cameras, objects, mounts and meshes of a workspace come in, one frozen record goes out."""
