"""Where things are: points of the ground, coordinates, bookmarks, views of a terrain. Knows no session."""
