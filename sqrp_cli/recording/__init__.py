"""Files of somebody's motion come in; joint positions over time, episode by episode, go out."""
