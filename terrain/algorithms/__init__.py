"""What to draw for a view, in numpy: a module per paper, and what several of them share."""
