"""The window and the command line. Nothing in `terrain` knows of them."""
